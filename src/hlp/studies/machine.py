"""Description of the machine on which something was measured."""

import os
import platform
import resource
import sys
from pathlib import Path
from typing import Any

import cv2
import torch

from hlp.config.settings import RunSettings
from hlp.stages.provenance import library_versions


def describe_machine(settings: RunSettings) -> dict[str, Any]:
    """Processor, memory, threads and versions; `load` is the average load of the last minute.

    What other processes do during the measurement is not known; a load near 0 before it suggests
    an idle machine.
    """
    cuda = torch.cuda.is_available()
    return {
        "cpu": _cpu_model(),
        "cores": len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count(),
        "memory_mib": _memory_mib(),
        "gpu": torch.cuda.get_device_name(0) if cuda else None,
        "system": platform.platform(),
        "load": round(os.getloadavg()[0], 2),
        "threads": {
            "machine": settings.machine.threads,
            "torch": torch.get_num_threads(),
            "opencv": cv2.getNumThreads(),
        },
        "versions": library_versions(),
    }


def peak_mib() -> float:
    """Peak resident memory of this process (MiB)."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def _cpu_model() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _memory_mib() -> int:
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2**20
