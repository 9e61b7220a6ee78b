"""Executors: they distribute frames, and views of objects, to workers."""

import logging
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
from typing import Annotated, Any, ClassVar, Literal, Protocol, TypeVar

from annotated_types import Le

from hlp.errors import MissingDependencyError, WorkerError
from hlp.settings import Count, Doc, Registry, Settings

Result = TypeVar("Result")
Threads = Annotated[Count, Le(1024), Doc("threads of each worker, in place of machine.threads (D)")]
_PACKAGES = {"dask": "distributed", "ray": "ray"}
_EVERY = 0.2  # s
_KILLED = (
    "worker processes were killed twice, as where memory is full: call again, which continues, "
    "with fewer executor.workers"
)
_DIED = "several workers of the cluster died of the same frame or object: their logs may say why"
_LOST = "no dask scheduler answers at {}: call again, which continues, when it does"
_logger = logging.getLogger(__name__)


class ExecutorSettings(Protocol):
    """Settings of an executor. Executors do not affect results."""

    parallel: ClassVar[bool]
    """Whether there are workers; otherwise the run's own process does the work."""

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
    workers: Annotated[Count, Le(1024), Doc("number of processes or threads (D)")] = 2
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
        if self.name == "dask":
            yield from _by_dask(self.address, work, keys)
            return
        import ray
        from ray.util.joblib import register_ray

        with ray.init(self.address):
            register_ray()
            yield from _by_joblib(self.name, -1, work, keys)  # it knows how many workers it has


def _by_dask(address: str, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
    """`ExecutorSettings.each` by the workers that a dask cluster has at the time.

    What a worker that goes has left is done by another, also by one that comes later. Raises
    WorkerError if the scheduler is not there, or if workers die of one key again and again.
    """
    from distributed import CancelledError, Client, KilledWorker, as_completed

    try:
        with _answering(address):
            client = Client(address)
        # Not joblib's backend: it waits for ever for what workers have died of.
        with client:
            there, done = None, as_completed(client.map(work, keys, pure=False))
            while not done.is_empty():
                there = _watched(there, client, address)
                for future in done.next_batch(block=False):
                    yield future.result()
                time.sleep(_EVERY)
    except CancelledError as error:
        raise WorkerError(_LOST.format(address)) from error
    except KilledWorker as error:
        raise WorkerError(_DIED) from error
    except RuntimeError as error:
        if isinstance(error.__cause__, ImportError):  # it reads what it hands on
            raise WorkerError(f"the dask scheduler lacks a package: {error.__cause__}") from error
        raise


@contextmanager
def _answering(address: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise WorkerError(_LOST.format(address)) from error


def _watched(before: set[str] | None, client: Any, address: str) -> set[str]:
    """The workers that are there; says which of those before have gone, and that there is none."""
    with _answering(address):
        there = {*client.nthreads()}
    for gone in sorted((before or set()) - there):
        _logger.warning("worker %s has gone: others do what it has left", gone)
    if not there and there != before:
        _logger.warning("no worker is there: waiting for one (dask worker %s)", address)
    return there


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
