"""Kernels: compiled again after changes, the types of those that are compiled ahead."""

import json
import os
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from jaxtyping import Bool, Int

import hlp
from bad_input import written
from hlp.kernels import array_type, parts_of
from hlp.refinement.cost_kernel import sum_costs
from hlp.refinement.swarm_kernel import update_personal_bests
from new_process import printed_by

CALLEE = """\
from hlp.kernels import compiled

@compiled(inline="always")
def doubled(x):
    return {factor} * x
"""
CALLER = """\
from hlp.kernels import compiled
from kernels.callee import doubled

@compiled()
def doubled_and_one(x):
    return doubled(x) + 1.0
"""
FILES = {"__init__.py": "", "callee.py": CALLEE.format(factor="2.0"), "caller.py": CALLER}
REPORT = """\
import json
from kernels.caller import doubled_and_one
value = doubled_and_one(3.0)
stats = doubled_and_one.stats
print(json.dumps([value, sum(stats.cache_hits.values()), sum(stats.cache_misses.values())]))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        written(tmp_path / "kernels" / name, text)
    return tmp_path / "kernels"


def call(package: Path, code: str = REPORT, **variables: str) -> Any:
    """What a process of its own prints: the kernel's value for 3, its cache's hits and misses."""
    paths = os.pathsep.join([str(Path(hlp.__file__).parents[1]), str(package.parent)])
    given = {"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": str(package.parent / "cache"), **variables}
    return json.loads(printed_by(code, PYTHONPATH=paths, PYTHONDONTWRITEBYTECODE="1", **given))


def test_a_kernel_is_compiled_again_when_any_source_behind_it_has_changed(package: Path) -> None:
    """Not when dates alone have; kernels are kept in the user's cache, not in the package."""
    assert call(package) == [7.0, 0, 1]
    folder = package.parent / "cache" / "hlp" / "kernels"
    assert {path.name.partition(".")[0] for path in folder.rglob("*.nbi")} == {"caller"}
    assert {*package.iterdir()} == {package / name for name in FILES}
    caller, callee = package / "caller.py", package / "callee.py"
    for path in (caller, callee):
        os.utime(path, (1_000_000_000, 1_000_000_000))
    assert call(package) == [7.0, 1, 0]
    before = callee.stat()
    callee.write_text(CALLEE.format(factor="5.0"))
    os.utime(callee, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert callee.stat().st_size == before.st_size
    assert call(package) == [16.0, 0, 1]
    # Kernels that others may write are not run, and where nothing can be kept, each is compiled.
    folder.chmod(0o777)
    assert call(package) == [16.0, 0, 1]
    assert call(package, XDG_CACHE_HOME="/proc/nowhere") == [16.0, 0, 1]  # not even root's


def test_kernels_run_uncompiled_where_numba_is_told_so(package: Path) -> None:
    code = "from kernels.caller import doubled_and_one as kernel; print(kernel(3.0))"
    assert call(package, code, NUMBA_DISABLE_JIT="1") == 7.0


def test_it_is_said_once_that_kernels_are_compiled(package: Path) -> None:
    code = (
        "import json, logging\nlines, handler = [], logging.Handler()\nlogger = logging.root\n"
        "handler.emit = lines.append\nlogger.addHandler(handler)\nlogger.setLevel('INFO')\n"
        "from kernels.caller import doubled_and_one\ndoubled_and_one(3.0)\ndoubled_and_one(3)\n"
        "print(json.dumps(sum('compiling' in line.getMessage() for line in lines)))\n"
    )
    assert [call(package, code), call(package, code)] == [1, 0]


def test_without_numba_it_is_said_what_to_install(package: Path) -> None:
    code = (
        "import json, sys\nsys.modules['numba'] = None  # importing it raises ImportError\n"
        "from kernels.caller import doubled_and_one\ntry:\n    doubled_and_one(3.0)\n"
        "except ImportError as error:\n    print(json.dumps(str(error)))\n"
    )
    said = call(package, code)
    assert "pip install numba" in said and "HLP_COMPILE=1" in said


def test_what_is_compiled_ahead_takes_arrays_as_annotated_and_no_others() -> None:
    """Its machine code would read them as if they were those, and tell nothing."""
    position, cost = np.ones((2, 6)), np.array([1.0, 0.5])
    best, costs = np.zeros((2, 6)), np.full(2, 0.75)
    assert update_personal_bests(position, cost, best, costs) == 1
    assert best.tolist() == [[0.0] * 6, [1.0] * 6] and costs.tolist() == [0.75, 0.5]
    for other in (np.float32(best), best[:, ::-1], best[0], best.T):
        with pytest.raises(TypeError, match="update_personal_bests takes"):
            update_personal_bests(position, cost, other, costs)


def test_types_are_those_of_annotations() -> None:
    hints = get_type_hints(sum_costs._function)  # type: ignore[attr-defined]
    double, single = np.dtype(np.float64), np.dtype(np.float32)
    assert array_type(hints["poses"]) == (double, 3)
    assert array_type(parts_of(hints["images"])[1]) == (single, 3)
    assert array_type(Int[np.ndarray, "n 2"]) == (np.dtype(np.int64), 2)
    assert array_type(Bool[np.ndarray, "h w"]) == (np.dtype(np.bool_), 2)
    assert array_type(float) is None and parts_of(float) == []
    assert parts_of(tuple[float, int]) == [float, int] and len(parts_of(hints["limits"])) == 4
