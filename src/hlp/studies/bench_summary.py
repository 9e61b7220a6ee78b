"""Results of a benchmark: times by part, and how far two paths agree on the same frames."""

import os
import platform
import resource
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import UInt8

from hlp.config.settings import RunSettings
from hlp.evaluation.errors import nearest_symmetric_pose, rotation_error, translation_error
from hlp.records import ObjectModel, PoseEstimate, TargetScore
from hlp.results.summary_file import TargetKey, numbered_targets
from hlp.stages.manifest import library_versions
from hlp.studies.stopwatch import PARTS, SearchComparison, Spent

NOTHING = Spent(0.0, 0.0)
STAGES = tuple(dict.fromkeys(PARTS.values()))
TOTAL = "total"


@dataclass(frozen=True)
class TimedDetection:
    """One object looked for in one frame: the estimate, and the time of each part.

    `place` is the number of objects looked for in the frame before this one; `region` is the mask
    of stage 1, one bit per pixel.
    """

    estimate: PoseEstimate
    place: int
    spent: Mapping[str, Spent]
    region: UInt8[np.ndarray, "b"]

    @property
    def frame(self) -> tuple[int, int]:
        """Scene and frame."""
        return self.estimate.scene_id, self.estimate.frame_id


def summarise_path(
    detections: Sequence[TimedDetection], scores: Sequence[TargetScore]
) -> dict[str, Any]:
    """Times (ms) of the first object in a frame, of each further one and of whole frames.

    Each by part, by stage and in all: median and 95th percentile of the wall time, median of the
    CPU time. `by_objects` is the median time to look for that many objects in a frame: the first
    ones of each frame with at least as many. `add_recall` is the share of right targets.
    """
    frames: dict[tuple[int, int], list[TimedDetection]] = {}
    for each in detections:
        frames.setdefault(each.frame, []).append(each)
    whole = [_added([_by_part(each) for each in own]) for own in frames.values()]
    return {
        "add_recall": float(np.mean([score.add_correct for score in scores])),
        "first": _spreads([_by_part(each) for each in detections if each.place == 0]),
        "further": _spreads([_by_part(each) for each in detections if each.place > 0]),
        "frame": _spreads(whole),
        "by_objects": _by_objects(list(frames.values())),
    }


def bench_targets(
    detections: Sequence[TimedDetection], scores: Sequence[TargetScore]
) -> dict[str, dict[TargetKey, float]]:
    """Wall and CPU time (ms) of each search for an object, and each target's verdict by ADD(-S).

    A frame's first object is timed apart from its further ones. An object that is searched once for
    several instances has the time at the first of them.
    """
    keys = numbered_targets((each.scene_id, each.frame_id, each.object_id) for each in scores)
    values: dict[str, dict[TargetKey, float]] = {}
    for each in detections:
        unit = "further" if each.place else "first"
        key, spent = (*each.frame, each.estimate.object_id, 0), _sum(list(each.spent.values()))
        values.setdefault(f"ms {unit}", {})[key] = 1e3 * spent.wall
        values.setdefault(f"CPU {unit}", {})[key] = 1e3 * spent.cpu
    right = [float(score.add_correct) for score in scores]
    return {**values, "ADD(-S)": dict(zip(keys, right, strict=True))}


def summarise_whole(spent: Sequence[Mapping[str, Spent]]) -> dict[str, float]:
    """Median and 95th percentile (ms) of all parts together, and median of the CPU time."""
    return _spread([_sum(list(parts.values())) for parts in spent])


def _by_part(detection: TimedDetection) -> dict[str, Spent]:
    """Time of each part, of each stage and in all; 0 for parts that had nothing to do."""
    parts = {part: detection.spent.get(part, NOTHING) for part in PARTS}
    stages = {
        f"stage {stage}": _sum([parts[part] for part, of in PARTS.items() if of == stage])
        for stage in STAGES
    }
    return {**parts, **stages, TOTAL: _sum(list(parts.values()))}


def _added(times: Sequence[Mapping[str, Spent]]) -> dict[str, Spent]:
    return {name: _sum([each[name] for each in times]) for name in times[0]}


def _sum(spent: Sequence[Spent]) -> Spent:
    return Spent(sum(each.wall for each in spent), sum(each.cpu for each in spent))


def _spreads(times: Sequence[Mapping[str, Spent]]) -> dict[str, dict[str, float]]:
    names = times[0] if times else ()
    return {name: _spread([each[name] for each in times]) for name in names}


def _spread(spent: Sequence[Spent]) -> dict[str, float]:
    wall = [1e3 * each.wall for each in spent]
    return {
        "median_ms": float(np.median(wall)),
        "p95_ms": float(np.percentile(wall, 95)),
        "cpu_ms": float(np.median([1e3 * each.cpu for each in spent])),
    }


def _by_objects(frames: Sequence[Sequence[TimedDetection]]) -> dict[str, dict[str, float]]:
    """By number of objects: median time (ms) of the first ones, and the frames with that many."""
    sums = [
        np.cumsum([1e3 * _sum(list(each.spent.values())).wall for each in detections])
        for detections in frames
    ]
    table = {}
    for count in range(1, max(map(len, sums)) + 1):
        found = [own[count - 1] for own in sums if len(own) >= count]
        table[str(count)] = {"median_ms": float(np.median(found)), "frames": len(found)}
    return table


def compare_paths(
    detections: Mapping[str, Sequence[TimedDetection]],
    scores: Mapping[str, Sequence[TargetScore]],
    models: Mapping[int, ObjectModel],
    names: tuple[str, str],
    tolerance: tuple[float, float],
) -> dict[str, Any]:
    """How far the results of two paths agree on the same frames.

    `same_pose` is the share of poses within the tolerance (mm, degrees) of each other,
    `same_verdict` the share of targets that are right by ADD(-S) in both or in neither,
    `region_iou` the mean overlap of the regions.
    """
    own, other = (_in_order(detections[name]) for name in names)
    pairs = list(zip(own, other, strict=True))
    verdicts = [np.array([score.add_correct for score in scores[name]]) for name in names]
    same = [_same_pose(a.estimate, b.estimate, models, tolerance) for a, b in pairs]
    return {
        "same_pose": float(np.mean(same)),
        "same_verdict": float(np.mean(verdicts[0] == verdicts[1])),
        "region_iou": float(np.mean([_overlap(a.region, b.region) for a, b in pairs])),
    }


def ratios(
    own: Mapping[str, Mapping[str, float]], other: Mapping[str, Mapping[str, float]]
) -> dict[str, float | None]:
    """By part, the ratio of the other's median time to the own one; None where that is 0."""
    return {
        name: other[name]["median_ms"] / each["median_ms"] if each["median_ms"] else None
        for name, each in own.items()
        if name in other
    }


def _in_order(detections: Sequence[TimedDetection]) -> list[TimedDetection]:
    return sorted(detections, key=lambda each: (*each.frame, each.estimate.object_id))


def _same_pose(
    a: PoseEstimate,
    b: PoseEstimate,
    models: Mapping[int, ObjectModel],
    tolerance: tuple[float, float],
) -> bool:
    pose, other = a.pose_cam_obj, b.pose_cam_obj
    if pose is None or other is None:
        return pose is other
    alike = nearest_symmetric_pose(pose, other, models[a.object_id].symmetries)
    near = translation_error(pose, alike) * 1e3 <= tolerance[0]
    return near and bool(np.rad2deg(rotation_error(pose, alike)) <= tolerance[1])


def _overlap(a: UInt8[np.ndarray, "b"], b: UInt8[np.ndarray, "b"]) -> float:
    """Intersection over union of two masks, one bit per pixel; 1 if both are empty."""
    union = int(np.bitwise_count(a | b).sum())
    return int(np.bitwise_count(a & b).sum()) / union if union else 1.0


def summarise_search(searches: Sequence[SearchComparison]) -> dict[str, float] | None:
    """The configured search compared with the exact one on the same queries; None without queries.

    Recall of the k nearest and of the nearest entry, over all queries; medians of the time.
    """
    if not searches:
        return None
    queries = np.array([each.queries for each in searches])
    recall = np.average([each.recall for each in searches], weights=queries)
    first = np.average([each.first for each in searches], weights=queries)
    own = float(np.median([each.seconds for each in searches]))
    exact = float(np.median([each.exact_seconds for each in searches]))
    return {
        "queries": float(np.median(queries)),
        "recall": float(recall),
        "recall_of_nearest": float(first),
        "median_ms": 1e3 * own,
        "exact_ms": 1e3 * exact,
        "ratio": exact / own,
    }


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
