"""A pool of threads in which the caller also works, for kernels that release the GIL."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise
from typing import TypeVar

import numpy as np

_RANGES_PER_THREAD = 4  # short ranges balance threads that start late or run slowly

Result = TypeVar("Result")


class ThreadTeam:
    """The calling thread and `threads` - 1 helper threads.

    A thread that finishes an item takes the next one. The caller also works, because a helper may
    start milliseconds late on a busy machine. A helper that has not started when all items are
    taken is cancelled. Results do not depend on which thread processes which item.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._helpers = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    def map(self, function: Callable[[int], Result], count: int) -> list[Result]:
        """Results of `function(index)` for index 0 to `count` - 1, in order.

        Raises what `function` raises, once all running calls have ended.
        """
        results: dict[int, Result] = {}
        pending = iter(range(count))

        def run() -> None:
            for index in pending:
                results[index] = function(index)

        helpers = min(self.threads, count) - 1
        futures = [self._helpers.submit(run) for _ in range(helpers)] if self._helpers else []
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
        pieces = min(_RANGES_PER_THREAD * self.threads, count) if self._helpers else 1
        bounds = list(pairwise(np.linspace(0, count, pieces + 1).astype(int).tolist()))
        self.map(lambda piece: function(*bounds[piece]), len(bounds))
