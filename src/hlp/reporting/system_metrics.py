"""CPU and memory of a run's process over its time, as MLflow's own system metrics are logged.

MLflow's would need psutil, and are those of the whole machine, whoever else uses it.
"""

import logging
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hlp.reporting.mlflow_client import reason
from hlp.reporting.tracker import Tracker

INTERVAL = 10.0  # s, as MLflow's own
_STATM = Path("/proc/self/statm")  # Linux alone tells the memory of now


@contextmanager
def system_metrics(tracker: Tracker, interval: float = INTERVAL) -> Iterator[None]:
    """Log cores in use and memory (MB) of this process while the block runs, and at its end.

    A step is a second since the run began, also in a run that goes on. CPU time (s) and the largest
    memory (MB) of the whole block follow at the end, unless it fails. No thread is started without
    MLflow.
    """
    if tracker.run is None:
        yield
        return
    begun = time.process_time()
    ended = threading.Event()
    sampler = threading.Thread(
        target=_sample, args=(tracker, interval, ended), name="system metrics", daemon=True
    )
    sampler.start()
    try:
        yield
    finally:
        ended.set()
        sampler.join()
    tracker.log_metrics(
        {
            "system/cpu_seconds": time.process_time() - begun,
            "system/peak_memory_megabytes": _peak_memory(),
        }
    )


def _sample(tracker: Tracker, interval: float, ended: threading.Event) -> None:
    """Log what was used since the last time, until the block has ended."""
    try:
        began = tracker.send(lambda client, run_id: client.get_run(run_id).info.start_time) or 0
        clock, spent = time.perf_counter(), time.process_time()
        last = False
        while not last:
            last = ended.wait(interval)
            now, used = time.perf_counter(), time.process_time()
            cores = (used - spent) / max(now - clock, 1e-3)
            clock, spent = now, used
            step = max(0, int(time.time() - began / 1000))
            values = {"system/cpu_cores": cores, "system/memory_megabytes": _memory()}
            tracker.log_metrics(values, step)
    except Exception as error:  # the run's own next call says what is wrong, or goes on elsewhere
        logging.getLogger(__name__).warning("no more system metrics: %s", reason(error))


def _memory() -> float | None:
    """Memory of this process now (MB); None where the system does not tell."""
    if not _STATM.is_file():
        return None
    return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _peak_memory() -> float | None:
    """Largest memory of this process so far (MB); None where the system does not tell."""
    if sys.platform == "win32":
        return None
    import resource

    unit = 1 if sys.platform == "darwin" else 1024  # bytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
