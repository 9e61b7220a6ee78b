"""Whether this machine has what HLP needs: libraries, threads, memory, disk."""

import os
import re
import shutil
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path

from hlp.checks import Finding

_THREAD_KEYS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_LEAST_DISK = 2.0e9  # bytes that learning an object takes for a while


def check_libraries(requirements: Sequence[str] | None = None) -> list[Finding]:
    """Required libraries that are missing; by default those of the installed package."""
    stated = requires("hlp") if requirements is None else requirements
    found = []
    for requirement in stated or ():
        if "extra ==" in requirement:
            continue
        name = re.split(r"[\s<>=!~;\[(]", requirement)[0]
        try:
            version(name)
        except PackageNotFoundError:
            advice = f"pip install '{requirement}'"
            found.append(Finding("libraries", name, "it is not installed", advice))
    return found


def check_threads(
    environment: Mapping[str, str] = os.environ, cores: int | None = None
) -> list[Finding]:
    """Variables that make libraries spin, or use more threads than there are cores."""
    usable = (os.cpu_count() or 1) if cores is None else cores
    found = []
    if environment.get("OMP_WAIT_POLICY", "PASSIVE").upper() == "ACTIVE":
        problem = "idle threads keep their cores busy, which can cost a factor of twenty"
        found.append(Finding("threads", "OMP_WAIT_POLICY=ACTIVE", problem, "Set it to PASSIVE"))
    for key in _THREAD_KEYS:
        text = environment.get(key, "")
        if text.isdecimal() and int(text) > usable:
            problem, advice = f"this machine has {usable} cores", f"Set it to {usable} or less"
            found.append(Finding("threads", f"{key}={text}", problem, advice))
    return found


def check_disk(folder: Path, free: float | None = None) -> list[Finding]:
    """Too little room where what is learnt is kept."""
    place = next(path for path in (folder, *folder.parents) if path.exists())
    left = float(shutil.disk_usage(place).free) if free is None else free
    if left >= _LEAST_DISK:
        return []
    needed = f"learning an object takes up to {_LEAST_DISK / 1e9:g}"
    advice = "Free some, or choose another folder with work=FOLDER"
    return [Finding("disk", str(folder), f"{left / 1e9:.1f} GB are free; {needed}", advice)]


def describe_machine() -> list[str]:
    """What is there, in lines for people."""
    optional = [name for name in ("OpenEXR", "pyrealsense2", "OpenGL") if find_spec(name)]
    return [
        f"{os.cpu_count()} cores, numba {version('numba')}, onnxruntime {version('onnxruntime')}, "
        f"opencv {version('opencv-python-headless')}",
        f"optional: {', '.join(optional) or 'nothing'}",
    ]
