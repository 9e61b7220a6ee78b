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
from hlp.compiled import compiled

@compiled(inline="always")
def doubled(x):
    return {factor} * x
"""
CALLER = """\
from hlp.compiled import compiled
from kernels.callee import doubled

@compiled()
def doubled_and_one(x):
    return doubled(x) + 1.0
"""
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
    (folder / "__init__.py").write_text("")
    (folder / "callee.py").write_text(CALLEE.format(factor="2.0"))
    (folder / "caller.py").write_text(CALLER)
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


def test_an_edit_in_another_file_is_compiled_even_with_the_old_date(package: Path) -> None:
    assert call(package) == [7.0, 0, 1]
    assert call(package) == [7.0, 1, 0]  # kept from process to process
    callee = package / "callee.py"
    before = callee.stat()
    callee.write_text(CALLEE.format(factor="5.0"))
    os.utime(callee, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert callee.stat().st_size == before.st_size
    assert call(package) == [16.0, 0, 1]
    assert call(package) == [16.0, 1, 0]


def test_a_new_date_of_the_same_source_compiles_nothing(package: Path) -> None:
    assert call(package) == [7.0, 0, 1]
    for name in ("caller.py", "callee.py"):
        os.utime(package / name, (1_000_000_000, 1_000_000_000))
    assert call(package) == [7.0, 1, 0]


def test_kernels_run_uncompiled_where_numba_is_told_so(package: Path) -> None:
    code = "from kernels.caller import doubled_and_one as kernel; print(kernel(3.0))"
    assert call(package, code, NUMBA_DISABLE_JIT="1") == 7.0


def test_kernels_are_kept_in_the_users_cache_and_the_package_is_not_written(package: Path) -> None:
    assert call(package) == [7.0, 0, 1]
    kept = (package.parent / "cache" / "hlp" / "kernels").rglob("*.nbi")
    assert {path.name.partition(".")[0] for path in kept} == {"caller"}
    assert sorted(path.name for path in package.iterdir()) == [
        "__init__.py", "callee.py", "caller.py",
    ]  # fmt: skip


def test_where_nothing_can_be_kept_every_process_compiles(package: Path) -> None:
    for _ in range(2):
        assert call(package, XDG_CACHE_HOME="/proc/nowhere") == [7.0, 0, 1]  # not even root's


def test_kernels_that_others_may_write_are_not_run(package: Path) -> None:
    folder = package.parent / "cache" / "hlp" / "kernels"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    assert call(package) == [7.0, 0, 1] and not any(folder.iterdir())
