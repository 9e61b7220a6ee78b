"""Compile kernels for a wheel (`hatch_build.py`): `python hatch_kernels.py FOLDER`.

Each extension module made there holds all kernels declared by `compiled_ahead`, for one type of
processor. It needs neither numba nor LLVM; making it needs both, and a C compiler.
"""

import os
import platform
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_origin

import numpy as np
from numba import from_dtype, types
from numba.core.compiler import Flags

sys.path.insert(0, str(Path(__file__).with_name("src")))

import hlp
from hlp.kernels import AheadKernel, array_type, parts_of

_X86 = {"avx2": "x86-64-v3", "base": "x86-64-v2"}
"""LLVM's names of processors; NumPy needs x86-64-v2."""


def compile_all(folder: Path) -> None:
    """Compile for all processors of this architecture, each in a process of its own.

    Numba reads the name of the processor once.
    """
    names = _X86 if platform.machine() in {"x86_64", "AMD64"} else {"base": "generic"}
    running = []
    with TemporaryDirectory() as cache:
        for level, name in names.items():
            numbas = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": cache}
            call = [sys.executable, __file__, str(folder), level]
            running.append(subprocess.Popen(call, env={**os.environ, **numbas}))  # noqa: S603
        if any([process.wait() for process in running]):
            raise SystemExit(
                "kernels were not compiled (this needs a C compiler and Python's headers)"
            )


def compile_for(folder: Path, level: str) -> None:
    """Compile for the processor that `NUMBA_CPU_NAME` names."""
    pycc = import_module("numba.pycc")  # warns that there is to be something else some day
    extension = pycc.CC(f"kernels_{level}", source_module=hlp)
    extension.output_dir, extension.target_cpu = str(folder), os.environ["NUMBA_CPU_NAME"]
    for kernel in find_kernels():
        arguments = tuple(map(numba_type, kernel.hints))
        kernel.compile(arguments)
        result = kernel.overloads[arguments].signature.return_type
        extension.export(kernel.symbol, result(types.Tuple(arguments)))(_exported(kernel))
    pycc.compiler.Flags = _releasing_the_gil  # there is no public option for it
    extension.compile()


def _exported(kernel: AheadKernel) -> Callable[[tuple[Any, ...]], Any]:
    """A function of a tuple: it has numba's default options, the kernel that it calls its own."""

    def call(arguments: tuple[Any, ...]) -> Any:
        return kernel(*arguments)

    return call


def find_kernels() -> list[AheadKernel]:
    """All kernels of the package that can be compiled ahead; the others' modules stay unread."""
    package = Path(hlp.__file__).parent
    found = []
    for path in sorted(package.rglob("*.py")):
        if "\n@compiled_ahead(" in path.read_text(encoding="utf-8"):
            name = ".".join(["hlp", *path.relative_to(package).with_suffix("").parts])
            values = vars(import_module(name)).values()
            kernels = [each for each in values if isinstance(each, AheadKernel)]
            found += [each for each in kernels if each.__module__ == name]
    return found


def numba_type(hint: Any) -> Any:
    """Numba's type of an annotated argument: an array, a tuple of such types, or a scalar."""
    if (array := array_type(hint)) is not None:
        return types.Array(from_dtype(array[0]), array[1], "C")
    if parts := tuple(map(numba_type, parts_of(hint))):
        named = () if get_origin(hint) is tuple else (hint,)
        return types.BaseTuple.from_types(parts, *named)
    return from_dtype(np.dtype(hint))


def _releasing_the_gil() -> Any:
    options = Flags()
    options.release_gil, options.no_cfunc_wrapper = True, True
    return options


if __name__ == "__main__":
    if len(sys.argv) == 2:
        compile_all(Path(sys.argv[1]))
    else:
        compile_for(Path(sys.argv[1]), sys.argv[2])
