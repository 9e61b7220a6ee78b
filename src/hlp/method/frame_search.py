"""The search for several objects in one frame: what detection and tracking share."""

import time
from collections.abc import Mapping

from hlp.method.conflicts import Found, resolve_conflicts
from hlp.method.detections import Detection, describe
from hlp.method.instance_search import find_instances
from hlp.method.pose_estimator import FrameContext, PoseEstimator
from hlp.refinement.verification import Observation


def search_frame(
    estimator: PoseEstimator,
    context: FrameContext,
    wanted: Mapping[int, int],
    min_score: float,
    begun: float,
    unexplained: Observation | None = None,
) -> tuple[list[Detection], list[int]]:
    """The answers to the wanted objects, and the ids of those without any.

    `wanted` maps object ids to the number of instances that are looked for. Work since `begun`
    (`time.perf_counter`) counts for the first object. `unexplained` is the frame without what is
    known to be there (None: nothing is).
    """
    found, seconds = _find(estimator, context, wanted, min_score, begun, unexplained)
    answers, missing = list[Detection](), list[int]()
    for object_id in wanted:
        refined = found[object_id]
        if refined is None:
            missing.append(object_id)
        else:
            answers += describe(estimator, context, object_id, refined, seconds[object_id])
    return answers, missing


def _find(
    estimator: PoseEstimator,
    context: FrameContext,
    wanted: Mapping[int, int],
    min_score: float,
    begun: float,
    unexplained: Observation | None,
) -> tuple[Found, dict[int, float]]:
    """What stage 3 found of the wanted objects, and the time (s) of each."""
    found: Found = {}
    regions, hypotheses, seconds = {}, {}, {}
    for object_id, count in wanted.items():
        region = estimator.find_region(context, object_id, count)
        coarse = estimator.find_hypotheses(context, region).hypotheses
        found[object_id] = find_instances(
            estimator, context, region, coarse, count, unexplained, min_score
        )
        regions[object_id], hypotheses[object_id] = region, coarse
        seconds[object_id] = time.perf_counter() - begun
        begun = time.perf_counter()
    found = resolve_conflicts(
        estimator, context, found, regions, hypotheses, wanted, min_score, unexplained
    )
    shared = (time.perf_counter() - begun) / max(len(wanted), 1)
    return found, {object_id: spent + shared for object_id, spent in seconds.items()}
