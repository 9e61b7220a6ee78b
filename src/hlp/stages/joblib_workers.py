"""Work distributed by joblib to processes or threads of this machine, or to a cluster."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Result = TypeVar("Result")


def each_by_joblib(
    backend: str, workers: int, work: Callable[[str], Result], keys: Sequence[str]
) -> Iterator[Result]:
    """Do the work once for each key, in any order; yields what it returns, as it comes.

    `backend` is joblib's name for the kind of workers, `workers` their number (-1: all).
    """
    from joblib import Parallel, delayed, parallel_config

    # Ray's backend returns nothing before everything is done.
    returned = "list" if backend == "ray" else "generator_unordered"
    with parallel_config(backend=backend, n_jobs=workers):
        parallel = Parallel(batch_size=1, return_as=returned)
        yield from parallel(delayed(_do)(work, key) for key in keys)


def _do(work: Callable[[str], Result], key: str) -> Result:
    # Joblib's dask backend hangs with functions that cannot be hashed, so it is given this one.
    return work(key)
