"""Kernels compiled by numba, and the threads that they, BLAS and OpenCV take.

A kernel is compiled again when any source behind it has changed. It releases the GIL, so that a
`ThreadTeam`, in which the caller also works, runs several at once.
"""

import logging
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import cache, update_wrapper
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar, cast

import cv2
import numpy as np
import platformdirs
import threadpoolctl
from threadpoolctl import ThreadpoolController, threadpool_limits

from hlp.fingerprints import source_digest

Function = TypeVar("Function", bound=Callable[..., Any])
_logger = logging.getLogger(__name__)
_lock = Lock()  # numba's folder is a setting of the whole process


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Decorator of a kernel that releases the GIL and is cached on disk between processes.

    `options` are numba's, which is imported when a kernel is used for the first time.

    Numba reuses a cached kernel as long as the kernel's own file has the same date and size: it
    misses edits of other files whose kernels are called or inlined, and edits with an old date.
    Here the source of its module and of all that it imports must be unchanged.

    Kernels lie in `NUMBA_CACHE_DIR`, or else in the user's cache folder. Where that cannot be
    written, every process compiles them again. The package's own folder is never written. Kernels
    fill rows by loops: to put arrays into slices, numba compiles checks of shapes for long.
    """

    def compile_later(function: Function) -> Function:
        return cast(Function, _Kernel(function, options))

    return compile_later


class _Kernel:
    """A function that numba compiles when it is used for the first time.

    Numba takes 0.3 s to import, for which a command that only shows settings need not wait. Numba
    takes a kernel in another one for what `_numba_type_` names, its dispatcher, and asks that for
    the options.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self._function, self._options = function, options
        self._kernel: Any = None
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self._dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._dispatcher, name)

    @property
    def _dispatcher(self) -> Any:
        if self._kernel is None:
            with _lock:  # of several threads, one makes it
                if self._kernel is None:
                    self._kernel = self._make_kernel()
        return self._kernel

    def _make_kernel(self) -> Any:
        numba = _numba()
        with _kept_in(kernel_folder(), numba.config) as keep:
            kernel: Any = numba.njit(nogil=True, cache=keep, **self._options)(self._function)
        kept: Any = getattr(kernel, "_cache", None)
        if hasattr(kept, "_cache_file"):  # not without a cache, nor where NUMBA_DISABLE_JIT is set
            # Private, as in numba 0.60 to 0.68 (pyproject.toml): numba compares this stamp with
            # the one in its index when it looks for a cached kernel. There is no public way to say
            # what a kernel depends on.
            kept._cache_file._source_stamp = source_digest(self._function.__module__)
            if not kept._cache_file._load_index():
                _say_that_it_compiles()
        return kernel


@cache
def _say_that_it_compiles() -> None:
    _logger.info("compiling for this machine, which is done once: about 15 s of computing")


@cache
def _numba() -> Any:
    """Numba with what it needs to load kernels, but for scipy.linalg.

    To see whether SciPy, which HLP requires, is there, numba imports that: 0.2 s of its 0.4 s. A
    kernel that needs BLAS still does.
    """
    import numba
    from numba.core.registry import cpu_target
    from numba.np import linalg

    check, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        cpu_target.target_context.refresh()
    finally:
        linalg.ensure_blas = check
    return numba


@cache
def kernel_folder() -> Path | None:
    """Where compiled kernels are kept; None if no folder can be written, by this user alone."""
    import numba

    config: Any = numba.config
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR)
    folder = platformdirs.user_cache_path("hlp", appauthor=False) / "kernels"
    if not folder.is_absolute():  # without a home it begins with "~"
        return None
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.stat()  # what lies there is run unseen
        if about.st_uid == os.getuid() and not about.st_mode & 0o022:
            return folder if os.access(folder, os.W_OK | os.X_OK) else None
    return None


@contextmanager
def _kept_in(folder: Path | None, config: Any) -> Iterator[bool]:
    """Numba's folder for the kernels that are declared in this block; whether there is one.

    It is put back afterwards: the kernels of other packages are not HLP's to move.
    """
    before = config.CACHE_DIR
    try:
        config.CACHE_DIR = "" if folder is None else str(folder)
        yield folder is not None
    finally:
        config.CACHE_DIR = before


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
