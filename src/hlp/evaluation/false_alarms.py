"""Answers for objects that are not in the image."""

from collections.abc import Sequence
from typing import Any

from hlp.evaluation.evaluator import FrameTruth
from hlp.records import PoseEstimate


def count_false_alarms(
    truths: Sequence[FrameTruth], estimates: Sequence[PoseEstimate], min_score: float
) -> dict[str, Any]:
    """How often an object that is no target of a frame was said to be there.

    `estimates` include those without a pose, since they tell what was looked for. `searched` counts
    pairs of object and frame without a target, `alarms` those with an answer of at least
    `min_score`; `rate` is their ratio, None if nothing was searched in vain.
    """
    present = {
        (truth.scene_id, truth.frame_id, target.object_id)
        for truth in truths
        for target in truth.targets
    }
    best: dict[tuple[int, int, int], float] = {}
    for each in estimates:
        key = (each.scene_id, each.frame_id, each.object_id)
        if key not in present:
            score = 0.0 if each.pose_cam_obj is None else each.score
            best[key] = max(best.get(key, 0.0), score)
    alarms = sum(score >= min_score for score in best.values())
    rate = alarms / len(best) if best else None
    return {"searched": len(best), "alarms": alarms, "min_score": min_score, "rate": rate}
