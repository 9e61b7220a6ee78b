"""Settings of the executors that distribute frames and views to workers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SerialSettings:
    """Config group `executor`: one frame after another, in the process of the run."""

    name: str


@dataclass(frozen=True)
class PoolSettings:
    """Config group `executor`: frames in parallel in `workers`, each with so many `threads`.

    Workers are processes of this machine (loky) or threads of the run's process (threading).
    """

    name: str
    workers: int
    threads: int


@dataclass(frozen=True)
class ClusterSettings:
    """Config group `executor`: frames on a running dask or ray cluster at `address`.

    Each of its workers uses so many `threads`.
    """

    name: str
    address: str
    threads: int


ExecutorSettings = SerialSettings | PoolSettings | ClusterSettings
