"""Executors: they distribute frames, and views of objects, to workers."""

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from typing import Annotated, ClassVar, Literal, Protocol, TypeVar

from annotated_types import Ge, Le

from hlp.errors import MissingDependencyError, WorkerError
from hlp.settings import Doc, Registry, Settings

Result = TypeVar("Result")
Threads = Annotated[
    int, Ge(1), Le(1024), Doc("threads of each worker, in place of machine.threads (D)")
]
_PACKAGES = {"dask": "distributed", "ray": "ray"}
_EVERY = 0.2  # s
_KILLED = (
    "worker processes were killed twice, as where memory is full: call again, which continues, "
    "with fewer executor.workers"
)


class ExecutorSettings(Protocol):
    """Settings of an executor. Executors do not affect results."""

    parallel: ClassVar[bool]
    """Whether there are workers; otherwise the run's own process does the work."""

    @property
    def name(self) -> str:
        """The alternative's name."""

    @property
    def threads(self) -> int:
        """Threads of each worker, in place of `machine.threads`."""

    def require(self) -> None:
        """Raise MissingDependencyError, which says what to install, if a package is missing."""

    def each(self, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
        """Do the work once for each key, in any order; yields what it returns, as it comes.

        `work` is sent to the workers by pickle. Raises the errors that it raises there.
        """


EXECUTORS: Registry[ExecutorSettings] = Registry("executor", "hlp.stages")
"""Alternatives of config group `executor`."""


@EXECUTORS.register
@dataclass(frozen=True)
class SerialSettings(Settings):
    """Config group `executor`: one after another, in the run's own process."""

    name: Literal["serial"] = "serial"

    parallel: ClassVar[bool] = False
    threads: ClassVar[int] = 1

    def require(self) -> None:
        """Nothing is needed."""

    def each(self, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
        """One after another."""
        yield from map(work, keys)


@EXECUTORS.register
@dataclass(frozen=True)
class PoolSettings(Settings):
    """Config group `executor`: workers on this machine, each with its own networks and codebooks.

    Workers are processes (loky) or threads of the run's process (threading). Each has `threads`.
    """

    name: Literal["loky", "threading"] = "loky"
    workers: Annotated[int, Ge(1), Le(1024), Doc("number of processes or threads (D)")] = 2
    threads: Threads = 1

    parallel: ClassVar[bool] = True

    def require(self) -> None:
        """Nothing is needed: both come with joblib."""

    def each(self, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
        """See `ExecutorSettings.each`."""
        return _by_joblib(self.name, self.workers, work, keys)


@EXECUTORS.register
@dataclass(frozen=True, kw_only=True)
class ClusterSettings(Settings):
    """Config group `executor`: workers of a running dask or ray cluster.

    They need the same version of HLP; work and data.root must be absolute paths on a shared disk.
    """

    name: Literal["dask", "ray"]
    address: Annotated[str, Doc("tcp://HOST:8786 (dask); auto: the cluster of this machine (ray)")]
    threads: Threads = 1

    parallel: ClassVar[bool] = True

    def require(self) -> None:
        """See `ExecutorSettings.require`."""
        if find_spec(_PACKAGES[self.name]) is None:
            name = self.name
            raise MissingDependencyError(
                f"executor={name} needs the extra '{name}': pip install 'hlp[{name}]'"
            )

    def each(self, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
        """See `ExecutorSettings.each`."""
        with self._connected():
            # Clusters know how many workers they have.
            yield from _by_joblib(self.name, -1, work, keys)

    @contextmanager
    def _connected(self) -> Iterator[None]:
        if self.name == "dask":
            from distributed import Client

            with Client(self.address):
                yield
        else:
            import ray
            from ray.util.joblib import register_ray

            with ray.init(self.address):
                register_ray()
                yield


def _by_joblib(
    backend: str, workers: int, work: Callable[[str], Result], keys: Sequence[str]
) -> Iterator[Result]:
    """`ExecutorSettings.each` by one of joblib's backends with so many workers (-1: all).

    What a worker that is killed has left is done once more. Raises WorkerError for a second one.
    """
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    # Ray's backend returns nothing before everything is done.
    returned = "list" if backend == "ray" else "generator_unordered"
    with parallel_config(backend=backend, n_jobs=workers), warnings.catch_warnings():
        # When the run is stopped.
        warnings.filterwarnings("ignore", message=".*by the workers have been cancelled.*")
        do = partial(_do, os.getpid() if backend == "loky" else None)
        left, again = dict.fromkeys(keys), True
        while left:
            parallel = Parallel(batch_size=1, return_as=returned)
            try:
                for key, result in parallel(delayed(do)(work, key) for key in [*left]):
                    del left[key]
                    yield result
            except TerminatedWorkerError as error:
                if not again:
                    raise WorkerError(_KILLED) from error
                again = False


def _do(parent: int | None, work: Callable[[str], Result], key: str) -> tuple[str, Result]:
    """The key, and what the work for it returns.

    A process other than its parent, if that is given, ends with it.

    Joblib's dask backend hangs with functions that cannot be hashed, so it is given this one.
    """
    if parent is not None and os.getpid() != parent:  # one worker is the run's own process
        ends_with(parent)
    return key, work(key)


@cache
def ends_with(parent: int) -> None:
    """End this process soon after its parent, however that ends; leave Ctrl-C to the parent.

    Otherwise a worker would finish its work, writing into folders whose locks are free already.
    `parent` is the parent's process id. A second call has no effect.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_EVERY)
        os._exit(1)

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=watch, name="parent", daemon=True).start()
