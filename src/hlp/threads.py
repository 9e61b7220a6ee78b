"""Teams of threads that share work, and the threads that BLAS and OpenCV take."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np
import threadpoolctl
from threadpoolctl import ThreadpoolController, threadpool_limits

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


def set_compute_threads(threads: int) -> None:
    """Set the threads of BLAS and OpenCV, so that the same settings give the same bits.

    The number of BLAS threads changes the last bits of sums. BLAS has little to do and gets one.
    """
    take_blas()
    threadpool_limits(1, user_api="blas")
    cv2.setNumThreads(threads)


def take_blas() -> None:
    """Let this thread of Python set BLAS's threads, whichever has set them before.

    Since threadpoolctl 3.8 only the first thread that does may do so again, and what others ask for
    is passed over in silence.
    """
    controller = threadpoolctl.OpenBLASController
    if hasattr(controller, "clear_controlling_thread"):
        controller.clear_controlling_thread(force=True)


class OneBlasThread:
    """Gives BLAS one thread in this process as long as anybody is within the block.

    Blocks of several threads may overlap: the threads that BLAS had come back after the last one.
    """

    def __init__(self) -> None:
        self._guard, self._inside = threading.Lock(), 0

    @contextmanager
    def __call__(self, libraries: ThreadpoolController) -> Iterator[None]:
        """The block; `libraries` are those that are limited."""
        with self._guard:
            if self._inside == 0:
                take_blas()
                self._limit = libraries.limit(limits=1, user_api="blas")
            self._inside += 1
        try:
            yield
        finally:
            with self._guard:
                self._inside -= 1
                if self._inside == 0:
                    take_blas()
                    self._limit.restore_original_limits()


one_blas_thread = OneBlasThread()
