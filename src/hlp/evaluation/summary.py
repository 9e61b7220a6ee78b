"""Summary of a run: recalls with intervals, per object, times, causes of misses.

The dictionary is what `summary.json` holds: a contract that scripts rely on.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hlp.arrays import Flags, Values
from hlp.evaluation import EvaluationSettings
from hlp.evaluation.evaluator import FrameTruth
from hlp.evaluation.waterfall import by_object, count_causes
from hlp.records import MILLIMETRES_PER_METRE, PoseEstimate, TargetScore
from hlp.results.recalls import (
    METRICS,
    Summary,
    average_recalls,
    blocks_of,
    recall_interval,
    reliability,
)

_POINTS = 101  # of the curve of risk and coverage, at most


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
    `total` and each stage, `votes` what `vote_quality` returns. There is at least one score.
    """
    objects = {
        name: {"targets": len(own), **_recalls(own, settings, seed)}
        for name, own in by_object(scores, names).items()
    }
    metrics = _recalls(scores, settings, seed)
    for name, values in metrics.items():
        values["mean_object"] = float(np.mean([own[name]["recall"] for own in objects.values()]))
    return {
        "targets": len(scores),
        "metrics": metrics,
        "per_object": objects,
        "median_errors": _median_errors(scores),
        "bop": average_recalls(scores),
        "calibration": summarise_calibration(scores),
        "policy": settings.name,
        "timing_ms": {stage: _times(values) for stage, values in timings_ms.items()},
        "waterfall": count_causes(scores, names),
        "votes": dict(votes),
    }


def _recalls(scores: Sequence[TargetScore], settings: EvaluationSettings, seed: int) -> Summary:
    return {
        name: with_interval(scores, correct, settings.bootstrap, seed)
        for name, correct in METRICS.items()
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
    return {"recall": float(right.mean()), "ci95": list(interval)}


def _median_errors(scores: Sequence[TargetScore]) -> Summary:
    """Medians over the targets that got a pose, right or wrong."""
    found = [score for score in scores if score.found]

    def median(error: str, unit: float = 1.0) -> float | None:
        errors = [getattr(score, error) for score in found]
        return float(np.median(errors)) * unit if found else None

    return {
        "found": len(found),
        "add_mm": median("add_error", MILLIMETRES_PER_METRE),
        "rotation_deg": median("rotation_error", math.degrees(1.0)),
        "translation_mm": median("translation_error", MILLIMETRES_PER_METRE),
        "box_iou": median("box_iou"),
    }


def _times(values: Sequence[float]) -> Summary:
    if not len(values):
        return {"median": None, "p95": None}
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}


def scores_in_vain(truths: Sequence[FrameTruth], estimates: Sequence[PoseEstimate]) -> list[float]:
    """The best score of each object in each frame of which it is no target; 0 without an answer.

    `estimates` include those without a pose, since they tell what was looked for.
    """
    present = {(t.scene_id, t.frame_id, own.object_id) for t in truths for own in t.targets}
    best: dict[tuple[int, int, int], float] = {}
    for estimate in estimates:
        key = (estimate.scene_id, estimate.frame_id, estimate.object_id)
        if key not in present:
            score = 0.0 if estimate.pose_cam_obj is None else estimate.score
            best[key] = max(best.get(key, 0.0), score)
    return list(best.values())


def count_false_alarms(scores: Sequence[float], min_score: float) -> dict[str, Any]:
    """How often an object that is no target of a frame was said to be there (`scores_in_vain`).

    `searched` counts pairs of object and frame, `alarms` those with an answer of at least
    `min_score`; `rate` is their ratio, None if nothing was searched in vain. `scores` are those of
    all answers, the highest first.
    """
    alarms = sum(score >= min_score for score in scores)
    rate = alarms / len(scores) if scores else None
    answers = sorted((score for score in scores if score > 0.0), reverse=True)
    found = {"searched": len(scores), "alarms": alarms, "min_score": min_score, "rate": rate}
    return found | {"scores": answers}


def expected_calibration_error(scores: Values, right: Flags, bins: int = 10) -> float:
    """Mean of |share of right answers − mean score| over bins of equal width, by their answers.

    Guo et al., On Calibration of Modern Neural Networks (ICML 2017), Eq. 3.
    """
    count, score, share = reliability(scores, right, bins).T
    return float((count * np.abs(score - share)).sum() / count.sum())


def calibration_error_by_chance(scores: Values, bins: int = 10) -> float:
    """Mean `expected_calibration_error` if each answer was right as often as its score says.

    The fewer answers, the larger it is: an error that is no larger speaks against no score. Exact,
    by the distribution of the number of right answers in each bin (Poisson binomial).
    """
    total = 0.0
    places = np.minimum((scores * bins).astype(int), bins - 1)
    for place in np.unique(places):
        inside, chances = scores[places == place], np.ones(1)
        for score in inside:
            chances = np.convolve(chances, [1.0 - score, score])
        total += float(chances @ np.abs(np.arange(len(chances)) - inside.sum()))
    return total / len(scores)


def risk_coverage(scores: Values, right: Flags) -> tuple[Values, Values]:
    """Coverage and risk at every threshold, the highest score first; equal scores come together."""
    order = np.argsort(-scores, kind="stable")
    count = np.arange(1, len(scores) + 1)
    risk = np.cumsum(~right[order]) / count
    last = np.append(np.diff(scores[order]) != 0, True)
    return count[last] / len(scores), risk[last]


def area_under_risk_coverage(scores: Values, right: Flags) -> float:
    """Mean risk over all coverages (Geifman et al., ICLR 2019); 0 is best.

    Answers with equal scores each have their expected risk.
    """
    coverage, risk = risk_coverage(scores, right)
    count = np.rint(coverage * len(scores))
    ends = np.concatenate([[0.0], count]).astype(int)
    lost = np.concatenate([[0.0], count * risk])
    steps = np.arange(1, len(scores) + 1)
    # Within equal scores the expected number of wrong answers grows linearly.
    return float((np.interp(steps, ends, lost) / steps).mean())


def summarise_calibration(targets: Sequence[TargetScore]) -> dict[str, Any]:
    """What `summary.json` holds under `calibration`; numbers are None without any answer.

    `reliability` has a row [answers, mean score, share of right ones] for each used bin,
    `risk_coverage` up to 101 points [coverage, risk].
    """
    found = [target for target in targets if target.found and np.isfinite(target.score)]
    if not found:
        none = dict.fromkeys(("ece", "ece_by_chance", "aurc"))
        return {"answers": 0, **none, "reliability": [], "risk_coverage": []}
    scores = np.array([target.score for target in found], dtype=np.float64)
    right = np.array([target.add_s_correct for target in found], dtype=bool)
    curve = np.column_stack(risk_coverage(scores, right))
    shown = np.unique(np.linspace(0, len(curve) - 1, _POINTS).round().astype(int))
    return {
        "answers": len(found),
        "ece": expected_calibration_error(scores, right),
        "ece_by_chance": calibration_error_by_chance(scores),
        "aurc": area_under_risk_coverage(scores, right),
        "reliability": reliability(scores, right).tolist(),
        "risk_coverage": curve[shown].tolist(),
    }
