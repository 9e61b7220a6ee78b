"""Work distributed by joblib to processes or threads of this machine, or to a cluster."""

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeVar

from hlp.stages.worker_end import ends_with

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
    with parallel_config(backend=backend, n_jobs=workers), warnings.catch_warnings():
        # When the run is stopped.
        warnings.filterwarnings("ignore", message=".*by the workers have been cancelled.*")
        parallel = Parallel(batch_size=1, return_as=returned)
        do = partial(_do_in_process, os.getpid()) if backend == "loky" else _do
        yield from parallel(delayed(do)(work, key) for key in keys)


def _do(work: Callable[[str], Result], key: str) -> Result:
    # Joblib's dask backend hangs with functions that cannot be hashed, so it is given this one.
    return work(key)


def _do_in_process(parent: int, work: Callable[[str], Result], key: str) -> Result:
    if os.getpid() != parent:  # one worker is the run's own process
        ends_with(parent)
    return work(key)
