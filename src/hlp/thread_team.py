"""Work shared out between the calling thread and helpers, for kernels that release the GIL."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise
from typing import TypeVar

import numpy as np

_PIECES = 4  # of a range, for each thread: whoever is late or slow takes fewer

Result = TypeVar("Result")


class ThreadTeam:
    """The calling thread and `threads` − 1 helpers.

    Whoever is free takes the next item, the caller among them: on two busy cores a helper may wake
    late, sometimes by milliseconds, and nothing waits for it then. Who does what changes no result.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._helpers = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    def each(self, work: Callable[[int], Result], count: int) -> list[Result]:
        """Results of the items 0 to `count` − 1, in order; raises what the work raises."""
        results: dict[int, Result] = {}
        pending = iter(range(count))

        def labour() -> None:
            for index in pending:
                results[index] = work(index)

        helpers = min(self.threads, count) - 1
        helping = [self._helpers.submit(labour) for _ in range(helpers)] if self._helpers else []
        try:
            labour()
        finally:
            begun = [each for each in helping if not each.cancel()]
            wait(begun)
        for each in begun:
            each.result()
        return [results[index] for index in range(count)]

    def ranges(self, work: Callable[[int, int], None], count: int) -> None:
        """Do the work from a first to before a last item, until all `count` are done."""
        pieces = min(_PIECES * self.threads, count) if self._helpers else 1
        bounds = list(pairwise(np.linspace(0, count, pieces + 1).astype(int).tolist()))
        self.each(lambda piece: work(*bounds[piece]), len(bounds))
