"""Executors: they distribute frames, and views of objects, to workers."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated, ClassVar, Literal, Protocol, TypeVar

from annotated_types import Ge, Le

from hlp.errors import MissingDependencyError
from hlp.registry import Registry
from hlp.settings import Doc, Settings
from hlp.stages.joblib_workers import each_by_joblib

Result = TypeVar("Result")

_PACKAGES = {"dask": "distributed", "ray": "ray"}


class ExecutorSettings(Protocol):
    """Settings of an executor. Executors do not affect results."""

    parallel: ClassVar[bool]
    """Whether there are workers; otherwise the run's own process does the work."""

    @property
    def name(self) -> str:
        """The alternative's name."""
        ...

    @property
    def threads(self) -> int:
        """Threads of each worker, in place of `machine.threads`."""
        ...

    def require(self) -> None:
        """Raise MissingDependencyError, which says what to install, if a package is missing."""
        ...

    def each(self, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
        """Do the work once for each key, in any order; yields what it returns, as it comes.

        `work` is sent to the workers by pickle. Raises the errors that it raises there.
        """
        ...


EXECUTORS: Registry[ExecutorSettings] = Registry("executor", "hlp.stages")
"""Alternatives of config group `executor`."""
_THREADS = "threads of each worker, in place of machine.threads (D)"


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
    threads: Annotated[int, Ge(1), Le(1024), Doc(_THREADS)] = 1

    parallel: ClassVar[bool] = True

    def require(self) -> None:
        """Nothing is needed: both come with joblib."""

    def each(self, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
        """See `ExecutorSettings.each`."""
        return each_by_joblib(self.name, self.workers, work, keys)


@EXECUTORS.register
@dataclass(frozen=True, kw_only=True)
class ClusterSettings(Settings):
    """Config group `executor`: workers of a running dask or ray cluster.

    They need the same version of HLP; work and data.root must be absolute paths on a shared disk.
    """

    name: Literal["dask", "ray"]
    address: Annotated[str, Doc("tcp://HOST:8786 (dask); auto: the cluster of this machine (ray)")]
    threads: Annotated[int, Ge(1), Le(1024), Doc(_THREADS)] = 1

    parallel: ClassVar[bool] = True

    def require(self) -> None:
        """See `ExecutorSettings.require`."""
        if find_spec(_PACKAGES[self.name]) is None:
            extra = self.name
            raise MissingDependencyError(
                f"executor={extra} needs the extra '{extra}': pip install 'hlp[{extra}]'"
            )

    def each(self, work: Callable[[str], Result], keys: Sequence[str]) -> Iterator[Result]:
        """See `ExecutorSettings.each`."""
        with _connected(self.name, self.address):
            # Clusters know how many workers they have.
            yield from each_by_joblib(self.name, -1, work, keys)


@contextmanager
def _connected(cluster: str, address: str) -> Iterator[None]:
    if cluster == "dask":
        from distributed import Client

        with Client(address):
            yield
    else:
        import ray
        from ray.util.joblib import register_ray

        with ray.init(address):
            register_ray()
            yield
