"""Wall time and CPU time of the parts of detection, and how far two paths agree."""

import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from timeit import timeit
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from hlp.arrays import Pose
from hlp.config.settings import RunSettings
from hlp.evaluation.errors import rotation_error, translation_error
from hlp.geometry import nearest_symmetric_pose
from hlp.method.find.estimator import PoseEstimator
from hlp.records import ObjectModel, PoseEstimate, TargetScore

PARTS = {
    **dict.fromkeys(("windows", "network", "region"), 1),
    **dict.fromkeys(("cut", "encode", "search", "vote", "modes"), 2),
    **dict.fromkeys(("screen", "refine", "verify", "second_search"), 3),
}
"""Parts of detection in their order, each with its stage."""


class Spent(NamedTuple):
    """Wall time and CPU time of all threads of the process (s)."""

    wall: float
    cpu: float


class PartClock:
    """An observer of a search that adds up the time of each part, until `stop`.

    No time is lost or counted twice, as long as one thread searches.
    """

    def __init__(self) -> None:
        self._part: str | None = None
        self._begun = np.zeros(2)
        self._sums: dict[str, np.ndarray] = {}

    def enter(self, part: str | None) -> None:
        """Count time for this part from now on; None: for no part."""
        now = np.array([time.perf_counter(), time.process_time()])
        if self._part is not None:
            self._sums[self._part] = self._sums.get(self._part, 0.0) + (now - self._begun)
        self._part, self._begun = part, now

    def stop(self) -> dict[str, Spent]:
        """Time of each part since the last stop; parts that were never entered are absent."""
        self.enter(None)
        sums, self._sums = self._sums, {}
        return {part: Spent(*both.tolist()) for part, both in sums.items()}


@dataclass(frozen=True)
class TimedDetection:
    """One object looked for in one frame: the estimate, and the time of each part.

    `place` is the number of objects looked for in the frame before this one.
    """

    estimate: PoseEstimate
    place: int
    spent: Mapping[str, Spent]


def summarise_path(
    detections: Sequence[TimedDetection], scores: Sequence[TargetScore]
) -> dict[str, Any]:
    """Times (ms) of the first object in a frame, of each further one and of whole frames.

    Each by part, by stage and in all: median and 95th percentile of the wall time, median of the
    CPU time. `add_recall` is the share of right targets.
    """
    wall, cpu = (_milliseconds(detections, clock) for clock in ("wall", "cpu"))
    places, frame = wall.index.get_level_values("place"), ["scene", "frame"]
    return {
        "add_recall": float(np.mean([score.add_correct for score in scores])),
        "first": _spreads(wall[places == 0], cpu[places == 0]),
        "further": _spreads(wall[places > 0], cpu[places > 0]),
        "frame": _spreads(wall.groupby(frame).sum(), cpu.groupby(frame).sum()),
    }


def _milliseconds(detections: Sequence[TimedDetection], clock: str) -> pd.DataFrame:
    """A row for each search, a column for each part, each stage and the total."""
    nothing = Spent(0.0, 0.0)
    rows = [
        {part: 1e3 * getattr(found.spent.get(part, nothing), clock) for part in PARTS}
        for found in detections
    ]
    ids = [(own.estimate.scene_id, own.estimate.frame_id, own.place) for own in detections]
    table = pd.DataFrame(rows, pd.MultiIndex.from_tuples(ids, names=["scene", "frame", "place"]))
    stages = {
        f"stage {stage}": table[[part for part, of in PARTS.items() if of == stage]].sum(axis=1)
        for stage in dict.fromkeys(PARTS.values())
    }
    return table.assign(**stages, total=table.sum(axis=1))


def _spreads(wall: pd.DataFrame, cpu: pd.DataFrame) -> dict[str, dict[str, float]]:
    found = {"median_ms": wall.median(), "p95_ms": wall.quantile(0.95), "cpu_ms": cpu.median()}
    spreads: dict[str, dict[str, float]] = pd.DataFrame(found).reindex(wall.columns).T.to_dict()
    return spreads if len(wall) else {}


def share_of_same(
    own: Sequence[TimedDetection],
    other: Sequence[TimedDetection],
    models: Mapping[int, ObjectModel],
    tolerance: tuple[float, float],
) -> float:
    """Share of two paths' detections of the same objects whose poses are the same.

    That is within the tolerance (mm, degrees) of each other, up to the object's symmetries.
    """

    def same(pose: Pose | None, other: Pose | None, model: ObjectModel) -> bool:
        if pose is None or other is None:
            return pose is other
        alike = nearest_symmetric_pose(pose, other, model.symmetries)
        near = translation_error(pose, alike) * 1e3 <= tolerance[0]
        return near and bool(np.rad2deg(rotation_error(pose, alike)) <= tolerance[1])

    pairs = [(a.estimate, b.estimate) for a, b in zip(own, other, strict=True)]
    verdicts = [same(a.pose_cam_obj, b.pose_cam_obj, models[a.object_id]) for a, b in pairs]
    return float(np.mean(verdicts))


def load_timed(estimator: PoseEstimator, objects: Mapping[int, str]) -> dict[str, Any]:
    """Load networks and objects of an estimator that has not been used yet; seconds of each.

    An object is its codebook, index and mesh; `objects` are their names by id.
    """

    def load(object_id: int) -> None:
        estimator.matching.group(object_id)
        estimator.verifier(object_id)

    parts = {"classifier": lambda: estimator.scan, "encoder": lambda: estimator.encoder}
    networks = {name: timeit(get, number=1) for name, get in parts.items()}
    spent = {name: timeit(partial(load, i), number=1) for i, name in objects.items()}
    return {**networks, "objects": spent}


def describe_machine(settings: RunSettings) -> dict[str, Any]:
    """Processor, cores, threads; a `load` near 0 in the minute before suggests an idle machine."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "cpu": names[0] if names else platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "threads": settings.machine.threads,
        "load": round(os.getloadavg()[0], 2),
    }
