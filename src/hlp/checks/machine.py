"""Whether this machine has what HLP needs: libraries, threads, memory, disk."""

import importlib.util
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from hlp.checks.finding import Finding

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
            found.append(
                Finding("libraries", name, "it is not installed", f"pip install '{requirement}'")
            )
    return found


def check_threads(
    environment: Mapping[str, str] = os.environ, cores: int | None = None
) -> list[Finding]:
    """Variables that make libraries spin, or use more threads than there are cores."""
    usable = (os.cpu_count() or 1) if cores is None else cores
    found = []
    if environment.get("OMP_WAIT_POLICY", "PASSIVE").upper() == "ACTIVE":
        found.append(
            Finding(
                "threads",
                "OMP_WAIT_POLICY=ACTIVE",
                "idle threads keep their cores busy, which can cost a factor of twenty",
                "Set it to PASSIVE",
            )
        )
    for key in _THREAD_KEYS:
        text = environment.get(key, "")
        if text.isdecimal() and int(text) > usable:
            found.append(
                Finding(
                    "threads",
                    f"{key}={text}",
                    f"this machine has {usable} cores",
                    f"Set it to {usable} or less",
                )
            )
    return found


def check_disk(folder: Path, free: float | None = None) -> list[Finding]:
    """Too little room where what is learnt is kept."""
    place = next(each for each in (folder, *folder.parents) if each.exists())
    left = float(shutil.disk_usage(place).free) if free is None else free
    if left >= _LEAST_DISK:
        return []
    return [
        Finding(
            "disk",
            str(folder),
            f"{left / 1e9:.1f} GB are free; learning an object takes up to {_LEAST_DISK / 1e9:g}",
            "Free some, or choose another folder with work=FOLDER",
        )
    ]


def describe_machine() -> list[str]:
    """What is there, in lines for people."""
    optional = [name for name in ("OpenEXR", "pyrealsense2", "OpenGL") if _has(name)]
    return [
        f"{os.cpu_count()} cores, numba {version('numba')}, onnxruntime {version('onnxruntime')}, "
        f"opencv {version('opencv-python-headless')}",
        f"optional: {', '.join(optional) or 'nothing'}",
    ]


def _has(name: str) -> bool:
    return importlib.util.find_spec(name) is not None
