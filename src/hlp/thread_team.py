"""A pool of threads in which the caller also works, for kernels that release the GIL."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from itertools import pairwise
from typing import TypeVar

import numpy as np

_RANGES_PER_THREAD = 4  # short ranges balance threads that start late or run slowly

Result = TypeVar("Result")

_own = threading.local()


def threads_here(threads: int) -> int:
    """How many of `threads` the calling thread may use: its share while it works for a team.

    The share grows when others of the team run out of items.
    """
    shares: _Shares | None = getattr(_own, "shares", None)
    return threads if shares is None else min(threads, shares.of_one())


class _Shares:
    """Threads that the workers of one `ThreadTeam.map` divide among those still at work."""

    def __init__(self, threads: int, workers: int) -> None:
        self._threads, self._working = threads, workers
        self._guard = threading.Lock()

    def of_one(self) -> int:
        """How many threads each of the workers may use now."""
        return self._threads // max(self._working, 1)

    @contextmanager
    def taken(self) -> Iterator[None]:
        """The calling thread is one of the workers in the block, and has ended after it."""
        before = getattr(_own, "shares", None)
        _own.shares = self
        try:
            yield
        finally:
            _own.shares = before
            with self._guard:
                self._working -= 1


class ThreadTeam:
    """The calling thread and `threads` - 1 helper threads.

    A thread that finishes an item takes the next one. The caller also works, because a helper may
    start milliseconds late on a busy machine. A helper that has not started when all items are
    taken is cancelled. Results do not depend on which thread processes which item.

    A team that is used by a function which another team calls takes no more threads than that
    other team leaves it, so that threads do not multiply. Those of a worker that has run out of
    items go to the others.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._helpers = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    def map(self, function: Callable[[int], Result], count: int) -> list[Result]:
        """Results of `function(index)` for index 0 to `count` - 1, in order.

        Raises what `function` raises, once all running calls have ended; no other one begins.
        """
        results: dict[int, Result] = {}
        pending = iter(range(count))
        failed = threading.Event()
        threads = threads_here(self.threads)
        workers = max(min(threads, count), 1)
        shares = _Shares(threads, workers)

        def run() -> None:
            with shares.taken():
                for index in pending:
                    if failed.is_set():
                        break
                    try:
                        results[index] = function(index)
                    except BaseException:
                        failed.set()
                        raise

        futures = [self._helpers.submit(run) for _ in range(workers - 1)] if self._helpers else []
        try:
            run()
        finally:
            started = [future for future in futures if not future.cancel()]
            wait(started)
        for future in started:
            future.result()
        return [results[index] for index in range(count)]

    def map_ranges(self, function: Callable[[int, int], None], count: int) -> None:
        """Call `function(start, stop)` for consecutive ranges that cover 0 to `count` - 1."""
        threads = threads_here(self.threads)
        pieces = min(_RANGES_PER_THREAD * threads, count) if threads > 1 else 1
        bounds = list(pairwise(np.linspace(0, count, pieces + 1).astype(int).tolist()))
        self.map(lambda piece: function(*bounds[piece]), len(bounds))
