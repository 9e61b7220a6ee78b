"""Kernels compiled by numba, and compiled again when any source behind them has changed."""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

from hlp.source_code import source_digest

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Decorate a kernel: compiled without the GIL, and kept on disk from process to process.

    `options` are numba's. Numba itself keeps a compiled kernel as long as the kernel's own file has
    the same date and size: it misses an edit in another file whose kernels are inlined or called,
    and one that came with an old date, as by a checkout. Here the kept one counts only if the
    source of the module and of all that it imports is the same.
    """

    def compile_later(function: Function) -> Function:
        kernel: Any = njit(nogil=True, cache=True, **options)(function)
        kept = getattr(kernel, "_cache", None)
        if kept is not None:  # None where NUMBA_DISABLE_JIT is set
            # Numba compares this stamp with the one in its index when it looks for a kept kernel.
            kept._cache_file._source_stamp = source_digest(function.__module__)
        return kernel  # type: ignore[no-any-return]

    return compile_later
