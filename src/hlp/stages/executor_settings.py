"""Settings of the executors that share out frames and views."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SerialSettings:
    """Config group `executor`: frames one after another, in the run's own process."""

    name: str


@dataclass(frozen=True)
class PoolSettings:
    """Config group `executor`: frames in `workers` of this machine, each with `threads`.

    Workers are processes (loky) or threads of the run's process (threading).
    """

    name: str
    workers: int
    threads: int


@dataclass(frozen=True)
class ClusterSettings:
    """Config group `executor`: frames on a running dask or ray cluster at `address`.

    Each of its workers has `threads`.
    """

    name: str
    address: str
    threads: int


ExecutorSettings = SerialSettings | PoolSettings | ClusterSettings
