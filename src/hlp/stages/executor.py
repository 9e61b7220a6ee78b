"""Distributes frames or objects to workers by joblib: processes of this machine, or a cluster."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TypeVar

from hlp.errors import MissingDependencyError
from hlp.stages.executor_settings import ClusterSettings, ExecutorSettings, PoolSettings

Result = TypeVar("Result")

_PACKAGES = {"dask": "distributed", "ray": "ray"}


def require(executor: ExecutorSettings) -> None:
    """Raise MissingDependencyError, saying what to install, if a cluster's package is missing."""
    if isinstance(executor, ClusterSettings) and find_spec(_PACKAGES[executor.name]) is None:
        extra = executor.name
        raise MissingDependencyError(
            f"executor={extra} needs the extra '{extra}': pip install 'hlp[{extra}]'"
        )


def each_in_workers(
    executor: PoolSettings | ClusterSettings, work: Callable[[str], Result], keys: Sequence[str]
) -> Iterator[Result]:
    """Call `work` once for each key, in any order; yield each result as soon as it is there.

    `work` is sent to the workers by pickle. Raises what it raises there.
    """
    from joblib import Parallel, delayed, parallel_config

    with _connected(executor):
        # A cluster knows how many workers it has.
        count = executor.workers if isinstance(executor, PoolSettings) else -1
        # Ray's backend returns nothing before all is done.
        returned = "list" if executor.name == "ray" else "generator_unordered"
        with parallel_config(backend=executor.name, n_jobs=count):
            parallel = Parallel(batch_size=1, return_as=returned)
            yield from parallel(delayed(_do)(work, key) for key in keys)


def _do(work: Callable[[str], Result], key: str) -> Result:
    # Joblib's dask backend hangs if the function that it is given cannot be hashed.
    return work(key)


@contextmanager
def _connected(executor: PoolSettings | ClusterSettings) -> Iterator[None]:
    """Connect to the cluster, if the executor is one."""
    if isinstance(executor, PoolSettings):
        yield
    elif executor.name == "dask":
        from distributed import Client

        with Client(executor.address):
            yield
    else:
        import ray
        from ray.util.joblib import register_ray

        with ray.init(executor.address):
            register_ray()
            yield
