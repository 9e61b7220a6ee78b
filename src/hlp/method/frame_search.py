"""The search for several objects in one frame: what detection and tracking share."""

import time
from collections.abc import Mapping

from hlp.method.conflicts import Found, resolve_conflicts
from hlp.method.detections import Detection, describe
from hlp.method.instance_search import find_instances
from hlp.method.pose_estimator import FrameContext, PoseEstimator
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
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
    """What stage 3 found of the wanted objects, and the time (s) of each.

    The threads search different objects: that divides the work better than several threads do which
    search the same one.
    """
    ids = list(wanted)
    estimator.share_work(context, ids)
    shared = time.perf_counter() - begun

    def search(number: int) -> tuple[Region, Hypotheses, RefinedHypotheses | None, float]:
        object_id = ids[number]
        count, begun = wanted[object_id], time.perf_counter()
        region = estimator.find_region(context, object_id, count)
        coarse = estimator.find_hypotheses(context, region).hypotheses
        refined = find_instances(estimator, context, region, coarse, count, unexplained, min_score)
        return region, coarse, refined, time.perf_counter() - begun

    searched = dict(zip(ids, estimator.team.map(search, len(ids)), strict=True))
    begun = time.perf_counter()
    found = resolve_conflicts(
        estimator,
        context,
        {i: each[2] for i, each in searched.items()},
        {i: each[0] for i, each in searched.items()},
        {i: each[1] for i, each in searched.items()},
        wanted,
        min_score,
        unexplained,
    )
    each_last = (time.perf_counter() - begun) / max(len(ids), 1)
    seconds = {i: each[3] + each_last for i, each in searched.items()}
    if ids:
        seconds[ids[0]] += shared
    return found, seconds
