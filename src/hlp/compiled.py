"""Kernels compiled by numba, and recompiled when any source behind them has changed."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, update_wrapper
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar, cast

import platformdirs

from hlp.source_code import source_digest

Function = TypeVar("Function", bound=Callable[..., Any])
_lock = Lock()  # numba's folder is a setting of the whole process


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Decorator of a kernel that releases the GIL and is cached on disk between processes.

    `options` are numba's, which is imported when a kernel is used for the first time.

    Numba itself reuses a cached kernel as long as the kernel's own file has the same date and size.
    It misses edits of other files whose kernels are called or inlined, and edits with an old date,
    as after a checkout. Here a cached kernel is reused only if the source of its module and of all
    that it imports is unchanged.

    Kernels lie in `NUMBA_CACHE_DIR`, or else in the user's cache folder. Where that cannot be
    written, as without a home, every process compiles them again. The package's own folder is never
    written.
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
        import numba

        with _kept_in(kernel_folder(), numba.config) as keep:
            kernel: Any = numba.njit(nogil=True, cache=keep, **self._options)(self._function)
        kept: Any = getattr(kernel, "_cache", None)
        if hasattr(kept, "_cache_file"):  # not without a cache, nor where NUMBA_DISABLE_JIT is set
            # Private, as of numba 0.68, which pyproject.toml holds: numba compares this stamp with
            # the one in its index when it looks for a cached kernel. There is no public way to say
            # what a kernel depends on.
            kept._cache_file._source_stamp = source_digest(self._function.__module__)
        return kernel


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
