"""Time of detection, always measured by the run that reports it."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tqdm import tqdm

from hlp.config.build import Run, evenly
from hlp.method.pose_estimator import FrameContext, PoseEstimator
from hlp.records import PoseEstimate
from hlp.stages.detection import DetectionStages

STEPS = ("holistic", "local", "voting", "refinement")

Seconds = Mapping[str, float]


@dataclass(frozen=True)
class Timing:
    """Seconds of each step for each object looked for, in `frames` frames.

    `reused` names the stages whose results were found on disk: then these frames were looked at
    again to measure the time. `first_use_seconds` is what loading and compiling took before.
    """

    seconds: Sequence[Seconds]
    frames: int
    reused: tuple[str, ...]
    first_use_seconds: float | None

    def milliseconds(self) -> dict[str, list[float]]:
        """Milliseconds of one object in one frame, in all (`total`) and for each step."""
        total = [1000.0 * sum(each.values()) for each in self.seconds]
        steps = {name: [1000.0 * each[name] for each in self.seconds] for name in STEPS}
        return {"total": total, **steps}

    def summary(self) -> dict[str, Any]:
        """How the times were measured, for `summary.json`."""
        return {
            "frames": self.frames,
            "objects": len(self.seconds),
            "reused_stages": list(self.reused),
            "first_use_seconds": self.first_use_seconds,
        }


def without_partial_times(estimates: Sequence[PoseEstimate]) -> list[PoseEstimate]:
    """The estimates, without the times of those for which some steps were found on disk."""
    return [
        each if set(STEPS) <= each.seconds.keys() else replace(each, seconds={})
        for each in estimates
    ]


def measure_times(
    run: Run, detection: DetectionStages, estimates: Sequence[PoseEstimate]
) -> Timing:
    """The times of this run's own detections, or of `timing_frames` frames looked at once more.

    A time found on disk would be another run's, perhaps another machine's. So where any result was
    reused, some frames (spread evenly) go through all stages again in memory.
    """
    measured = [each.seconds for each in estimates]
    if all(set(STEPS) <= each.keys() for each in measured):
        return Timing(measured, len(run.keys), (), detection.first_use_seconds)
    keys = evenly(run.keys, run.settings.timing_frames)
    estimator = detection.estimator
    begun = time.perf_counter()
    _look(estimator, run, keys[0])  # loads and compiles
    first_use = time.perf_counter() - begun
    seconds: list[Seconds] = []
    for key in tqdm(keys, desc="times", unit="frame", disable=None):
        seconds += _look(estimator, run, key)
    reused = tuple(stage for stage, made in detection.reused.items() if made)
    return Timing(seconds, len(keys), reused, first_use)


def _look(estimator: PoseEstimator, run: Run, key: str) -> list[Seconds]:
    """Find every object of one frame; the seconds of its steps."""
    frame = run.dataset.frames.load(key)
    context = estimator.prepare(frame)
    return [_steps(estimator, context, object_id) for object_id in run.dataset.wanted(frame)]


def _steps(estimator: PoseEstimator, context: FrameContext, object_id: int) -> dict[str, float]:
    begun = time.perf_counter()
    region = estimator.find_region(context, object_id)
    holistic = time.perf_counter() - begun
    coarse = estimator.find_hypotheses(context, region)
    begun = time.perf_counter()
    estimator.refine(context, object_id, coarse.hypotheses)
    return {
        "holistic": holistic,
        "local": coarse.local_seconds,
        "voting": coarse.voting_seconds,
        "refinement": time.perf_counter() - begun,
    }
