"""Kernels compiled by numba: when they are first used, or before, for a wheel.

A kernel is compiled again when any source behind it has changed. It releases the GIL, so that a
`threads.ThreadTeam` runs several at once.
"""

import logging
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property, partial, update_wrapper
from importlib import import_module
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

import cv2
import numpy as np
import platformdirs

from hlp.errors import MissingDependencyError
from hlp.fingerprints import source_digest

Function = TypeVar("Function", bound=Callable[..., Any])
_logger = logging.getLogger(__name__)
_AVX2 = (9, 11, 12)  # OpenCV's numbers of FP16, AVX2 and FMA3
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
    return cast(Callable[[Function], Function], partial(_Kernel, options=options))


def compiled_ahead(**options: Any) -> Callable[[Function], Function]:
    """Decorator of a kernel that Python calls: of the types of its annotations alone.

    Otherwise as `compiled`, but a wheel may hold its machine code, which needs neither numba nor
    time (`hatch_kernels.py`). Arrays must be contiguous; `Float` without a width is float64, `Int`
    int64. With other arrays, calling it raises TypeError, compiled ahead or not.
    """
    return cast(Callable[[Function], Function], partial(AheadKernel, options=options))


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


class AheadKernel(_Kernel):
    """A kernel that may have been compiled ahead; see `compiled_ahead`."""

    def __call__(self, *arguments: Any) -> Any:
        """What the function returns. Raises TypeError, see `compiled_ahead`."""
        given = [(array.dtype, array.ndim) for array in _contiguous(arguments)]
        if given != self._expected:
            raise TypeError(f"{self.symbol} takes {self._expected}, contiguous, and not {given}")
        ahead = self._ahead
        return self._dispatcher(*arguments) if ahead is None else ahead(arguments)

    @property
    def symbol(self) -> str:
        """Its name among those of all modules."""
        return f"{self.__module__}.{self.__name__}".replace(".", "_")

    @cached_property
    def hints(self) -> list[Any]:
        """The types of its arguments, as annotated."""
        hints = get_type_hints(self._function, include_extras=True)
        return [hint for name, hint in hints.items() if name != "return"]

    @cached_property
    def _expected(self) -> list[tuple[np.dtype, int]]:
        return [*_arrays(self.hints)]

    @cached_property
    def _ahead(self) -> Callable[[tuple[Any, ...]], Any] | None:
        kernels = extension()
        return None if kernels is None else getattr(kernels, self.symbol)


def array_type(hint: Any) -> tuple[np.dtype, int] | None:
    """Type and number of axes of an annotated array: jaxtyping's, or records with their type.

    None for other annotations.
    """
    if get_origin(hint) is Annotated:
        return hint.__metadata__[0], 1
    if not hasattr(hint, "dtypes"):
        return None
    wide = {"float64", "int64"} & {*hint.dtypes}
    return np.dtype(wide.pop() if wide else hint.dtypes[0]), len(hint.dims)


def parts_of(hint: Any) -> list[Any]:
    """The annotations of the parts of a tuple, named or not; empty for other types."""
    fields = getattr(hint, "_fields", None)
    return list(get_args(hint)) if fields is None else [*get_type_hints(hint).values()]


def _arrays(hints: Iterable[Any]) -> Iterator[tuple[np.dtype, int]]:
    for hint in hints:
        if (expected := array_type(hint)) is None:
            yield from _arrays(parts_of(hint))
        else:
            yield expected


def _contiguous(values: Iterable[Any]) -> Iterator[np.ndarray]:
    """The arrays among values and in tuples among them, but for those with gaps."""
    for value in values:
        if isinstance(value, tuple):
            yield from _contiguous(value)
        elif isinstance(value, np.ndarray) and value.flags.c_contiguous:
            yield value


@cache
def extension() -> ModuleType | None:
    """The kernels that were compiled ahead for such a processor; None where none were."""
    level = "avx2" if all(map(cv2.checkHardwareSupport, _AVX2)) else "base"
    with suppress(ModuleNotFoundError):
        return import_module(f"hlp.kernels_{level}")
    return None


@cache
def _say_that_it_compiles() -> None:
    _logger.info("compiling for this machine, which is done once: about 15 s of computing")


@cache
def _numba() -> Any:
    """Numba with what it needs to load kernels, but for scipy.linalg.

    To see whether SciPy, which HLP requires, is there, numba imports that: 0.2 s of its 0.4 s. A
    kernel that needs BLAS still does. Raises MissingDependencyError where there is none.
    """
    try:
        import numba
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            "numba is not installed, and this HLP has no compiled kernels: pip install numba, or "
            "install HLP with HLP_COMPILE=1 (docs/own-object.md)"
        ) from error
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
