"""Summary of a run: recalls with intervals, per object, times, causes of misses.

The dictionary is what `summary.json` holds: a contract that scripts rely on.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hlp.evaluation.calibration import summarise_calibration
from hlp.evaluation.settings import EvaluationSettings
from hlp.evaluation.waterfall import count_causes
from hlp.records import TargetScore
from hlp.results.average_recalls import average_recalls
from hlp.results.intervals import blocks_of, recall_interval
from hlp.results.summary_file import METRICS, Summary


def summarise(
    scores: Sequence[TargetScore],
    names: Mapping[int, str],
    timings_ms: Mapping[str, Sequence[float]],
    votes: Mapping[str, Any],
    settings: EvaluationSettings,
    seed: int,
) -> Summary:
    """What `summary.json` holds: plain dictionaries of numbers, None where there is none.

    `names` are the objects' names by id, `timings_ms` the times of one object in one frame for
    `total` and each stage, `votes` what `vote_quality` returns. Raises ValueError without scores,
    and for an object without a name.
    """
    if not scores:
        raise ValueError("nothing to summarise: no target was scored")
    unknown = sorted({score.object_id for score in scores} - set(names))
    if unknown:
        raise ValueError(f"no name for the objects {unknown}")
    groups: dict[str, list[TargetScore]] = {}
    for score in sorted(scores, key=lambda item: item.object_id):
        groups.setdefault(names[score.object_id], []).append(score)
    return {
        "targets": len(scores),
        "metrics": _metrics(list(groups.values()), settings, seed),
        "per_object": {name: _object(group, settings, seed) for name, group in groups.items()},
        "median_errors": _median_errors(scores),
        "bop": average_recalls(scores),
        "calibration": summarise_calibration(scores),
        "policy": settings.name,
        "timing_ms": {stage: _times(values) for stage, values in timings_ms.items()},
        "waterfall": count_causes(scores, names),
        "votes": dict(votes),
    }


def with_interval(
    scores: Sequence[TargetScore],
    correct: Callable[[TargetScore], bool],
    resamplings: int,
    seed: int,
) -> Summary:
    """The recall over targets by a metric, and its 95 % interval by `recall_interval`."""
    right = np.array([correct(score) for score in scores], dtype=bool)
    blocks = blocks_of([(score.scene_id, score.frame_id) for score in scores])
    interval = recall_interval(right, blocks, resamplings, seed)
    return {"recall": _recall(scores, correct), "ci95": list(interval)}


def _recall(scores: Sequence[TargetScore], correct: Callable[[TargetScore], bool]) -> float:
    return sum(correct(score) for score in scores) / len(scores)


def _metrics(
    groups: Sequence[Sequence[TargetScore]], settings: EvaluationSettings, seed: int
) -> Summary:
    """Each metric's recall over all targets, its interval, and the mean of the groups' recalls."""
    scores = [score for group in groups for score in group]
    return {
        name: {
            **with_interval(scores, correct, settings.bootstrap, seed),
            "mean_object": float(np.mean([_recall(group, correct) for group in groups])),
        }
        for name, correct in METRICS.items()
    }


def _object(scores: Sequence[TargetScore], settings: EvaluationSettings, seed: int) -> Summary:
    recalls = {
        name: with_interval(scores, correct, settings.bootstrap, seed)
        for name, correct in METRICS.items()
    }
    return {"targets": len(scores), **recalls}


def _median_errors(scores: Sequence[TargetScore]) -> Summary:
    """Medians over the targets that got a pose, right or wrong."""
    found = [score for score in scores if score.found]
    if not found:
        return {
            "found": 0,
            "add_mm": None,
            "rotation_deg": None,
            "translation_mm": None,
            "box_iou": None,
        }
    return {
        "found": len(found),
        "add_mm": float(np.median([score.add_error for score in found]) * 1e3),
        "rotation_deg": float(np.rad2deg(np.median([score.rotation_error for score in found]))),
        "translation_mm": float(np.median([score.translation_error for score in found]) * 1e3),
        "box_iou": float(np.median([score.box_iou for score in found])),
    }


def _times(values: Sequence[float]) -> Summary:
    if not len(values):
        return {"median": None, "p95": None}
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}
