"""The search for several objects in one frame: what detection and tracking share."""

import time
from collections.abc import Mapping

import numpy as np

from hlp.method.find.conflicts import Found, resolve_conflicts
from hlp.method.find.detections import Detection, describe
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.method.find.instances import find_instances
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.verification import Observation

_LIKELIEST = 8  # windows by which it is judged whether an object is there


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
    there = [(i, refined) for i in wanted if (refined := found[i]) is not None]

    def describe_one(number: int) -> list[Detection]:
        object_id, refined = there[number]
        return describe(estimator, context, object_id, refined, seconds[object_id])

    answers = [each for own in estimator.team.map(describe_one, len(there)) for each in own]
    return answers, [i for i in wanted if found[i] is None]


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
    search the same one. Objects that the classifier is least sure of come first, because they take
    longest: at the end of the frame, no thread then waits long for the others.
    """
    ids = list(wanted)
    estimator.share_work(context, ids)
    shared = time.perf_counter() - begun

    def find_region(number: int) -> tuple[Region, float]:
        object_id, begun = ids[number], time.perf_counter()
        region = estimator.find_region(context, object_id, wanted[object_id])
        return region, time.perf_counter() - begun

    looked = dict(zip(ids, estimator.team.map(find_region, len(ids)), strict=True))
    regions = {object_id: region for object_id, (region, _) in looked.items()}
    began = time.perf_counter()
    estimator.share_patches(context, regions.values())
    shared += time.perf_counter() - began
    order = sorted(ids, key=lambda object_id: _evidence(regions[object_id]))

    def search(place: int) -> tuple[Hypotheses, RefinedHypotheses | None, float]:
        region, begun = regions[order[place]], time.perf_counter()
        count = wanted[region.object_id]
        coarse = estimator.find_hypotheses(context, region).hypotheses
        refined = find_instances(estimator, context, region, coarse, count, unexplained, min_score)
        return coarse, refined, time.perf_counter() - begun

    searched = dict(zip(order, estimator.team.map(search, len(ids)), strict=True))
    begun = time.perf_counter()
    found = resolve_conflicts(
        estimator,
        context,
        {i: searched[i][1] for i in ids},
        regions,
        {i: searched[i][0] for i in ids},
        wanted,
        min_score,
        unexplained,
    )
    each_last = (time.perf_counter() - begun) / max(len(ids), 1)
    seconds = {i: looked[i][1] + searched[i][2] + each_last for i in ids}
    if ids:
        seconds[ids[0]] += shared
    return found, seconds


def _evidence(region: Region) -> float:
    """How sure the classifier is that the object is there: its mean in the likeliest windows."""
    likeliest = np.sort(region.probabilities)[-_LIKELIEST:]
    return float(likeliest.mean()) if len(likeliest) else 0.0
