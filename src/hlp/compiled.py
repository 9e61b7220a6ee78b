"""Kernels compiled by numba, and recompiled when any source behind them has changed."""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

from hlp.source_code import source_digest

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Decorator of a kernel that releases the GIL and is cached on disk between processes.

    `options` are numba's. Numba itself reuses a cached kernel as long as the kernel's own file has
    the same date and size. It misses edits of other files whose kernels are called or inlined, and
    edits with an old date, as after a checkout. Here a cached kernel is reused only if the source
    of its module and of all that it imports is unchanged.
    """

    def compile_later(function: Function) -> Function:
        kernel: Any = njit(nogil=True, cache=True, **options)(function)
        kept = getattr(kernel, "_cache", None)
        if kept is not None:  # None where NUMBA_DISABLE_JIT is set
            # Numba compares this stamp with the one in its index when it looks for a cached kernel.
            kept._cache_file._source_stamp = source_digest(function.__module__)
        return kernel  # type: ignore[no-any-return]

    return compile_later
