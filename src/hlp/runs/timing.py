"""Time of detection, always measured by the run that reports it."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hlp.arrays import spread
from hlp.config.build import Run
from hlp.method.find.trace import STAGES, STEPS
from hlp.progress import Progress
from hlp.records import PoseEstimate
from hlp.stages.detection import DetectionStages, Seconds, seconds_of


@dataclass(frozen=True)
class Timing:
    """Seconds of each step for every object looked for in `frames` frames.

    `reused` names the stages whose results were found on disk; then these frames were processed
    again to measure the time. `first_use_seconds` is the time of the first frame, with everything
    that was loaded and compiled for it. It is not part of any other time. `cpu_seconds` is the CPU
    time of all threads in these frames. None: not known, because workers processed the frames.
    `load` is the machine's average load in the minute before the last frame was done.
    """

    seconds: Sequence[Mapping[str, float]]
    frames: int
    reused: tuple[str, ...]
    first_use_seconds: float | None
    cpu_seconds: float | None
    load: float

    def milliseconds(self) -> dict[str, list[float]]:
        """Milliseconds of one object in one frame, in all (`total`) and for each step."""
        total = [1000.0 * sum(steps.values()) for steps in self.seconds]
        by_step = {name: [1000.0 * steps[name] for steps in self.seconds] for name in STEPS}
        return {"total": total, **by_step}

    def summary(self) -> dict[str, Any]:
        """How the times were measured, for `summary.json`."""
        return {
            "frames": self.frames,
            "objects": len(self.seconds),
            "reused_stages": list(self.reused),
            "first_use_seconds": self.first_use_seconds,
            "cpu_ms": self._mean_ms(self.cpu_seconds),
            "wall_ms": self._mean_ms(sum(sum(steps.values()) for steps in self.seconds)),
            "load": self.load,
            "cores": os.cpu_count(),
        }

    def _mean_ms(self, seconds: float | None) -> float | None:
        """Mean of one object in one frame; CPU time cannot be told apart by object."""
        return None if seconds is None or not self.seconds else 1000 * seconds / len(self.seconds)


def measure_times(
    run: Run, detection: DetectionStages, estimates: Sequence[PoseEstimate]
) -> Timing:
    """The times of this run's own detections, or of `timing_frames` frames processed again.

    Times on disk would be those of another run, perhaps on another machine. So if any result was
    reused, some frames, spread evenly, go through all stages again, in memory.
    """
    if not detection.reused:
        measured = [estimate.seconds for estimate in estimates]
        frames = len(run.keys) - len(detection.failed)
        cpu = detection.cpu_seconds or None
        return Timing(measured, frames, (), detection.first_use_seconds, cpu, _load())
    sound = tuple(key for key in run.keys if key not in detection.failed)
    keys = spread(sound, run.settings.timing_frames)
    begun = time.perf_counter()
    _search(detection, keys[0])  # loads and compiles
    first_use = time.perf_counter() - begun
    seconds, cpu = list[Mapping[str, float]](), 0.0
    for key in Progress(keys, desc="times", unit="frame"):
        found, spent = _search(detection, key)
        seconds += found.values()
        cpu += spent
    reused = tuple(stage for stage in STAGES if stage in detection.reused)
    if detection.first_use_seconds is not None:  # an interrupted run's, which loaded before
        first_use = detection.first_use_seconds
    return Timing(seconds, len(keys), reused, first_use, cpu, _load())


def _search(detection: DetectionStages, key: str) -> tuple[Seconds, float]:
    """Find every object of one frame; the seconds of its steps, by object, and CPU seconds."""
    frame, begun = detection.load(key), time.process_time()
    return seconds_of(detection.search(frame)), time.process_time() - begun


def _load() -> float:
    return round(os.getloadavg()[0], 2)
