"""Two kernels in two files of a package outside of HLP; each process looks at them afresh."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import hlp

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
    folder = tmp_path / "kernels"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    return folder


def call(package: Path, code: str = REPORT, **variables: str) -> Any:
    """What a process of its own prints: the kernel's value for 3, its cache's hits and misses."""
    paths = os.pathsep.join([str(Path(hlp.__file__).parents[1]), str(package.parent)])
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)
    environment |= {"XDG_CACHE_HOME": str(package.parent / "cache"), **variables}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


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
