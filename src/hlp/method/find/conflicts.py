"""Objects of one frame compete for its pixels: what one pose explains supports no other."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.method.find.instances import find_instances
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.verification import Observation

Found = dict[int, RefinedHypotheses | None]
"""What stage 3 found, by object id; None where there was no hypothesis."""


def resolve_conflicts(
    estimator: PoseEstimator,
    context: FrameContext,
    found: Found,
    regions: Mapping[int, Region],
    hypotheses: Mapping[int, Hypotheses],
    wanted: Mapping[int, int],
    min_score: float | None = None,
    unexplained: Observation | None = None,
) -> Found:
    """What `find_instances` found for the objects of a frame, without double claims.

    In order of cost, the instances of all objects that have at least `min_score` take the pixels
    that they explain. If more than half of the pixels that agree with an instance are taken by
    other objects, its object is searched once more in the pixels that the others leave. `wanted`
    and `min_score` are `instances` and `min_score` of `find_instances`, `unexplained` is too.
    """
    if sum(each is not None for each in found.values()) < 2:
        return found
    claims: dict[int, list[int]] = {}
    free = context.observation if unexplained is None else unexplained
    left, losers = free, []
    for object_id, row in _by_cost(found):
        refined = found[object_id]
        assert refined is not None
        pose = refined.refined[row].pose_cam_obj
        if object_id in losers or not _counts(estimator, context, object_id, pose, min_score):
            continue
        verifier = estimator.verifier(object_id)
        evidence = verifier.evidence(context.observation, pose[None])
        if verifier.is_free(left, pose[None], evidence)[0]:
            left = verifier.without_explained(left, pose)
            claims.setdefault(object_id, []).append(row)
        else:
            losers.append(object_id)
    resolved = dict(found)
    for object_id in losers:
        others = {i: rows for i, rows in claims.items() if i != object_id}
        left = _left_by(estimator, free, resolved, others)
        own = regions[object_id], hypotheses[object_id], wanted[object_id]
        again = find_instances(estimator, context, *own, left, min_score)
        resolved[object_id] = again
        claims[object_id] = [] if again is None else list(again.instances)
    return resolved


def _counts(
    estimator: PoseEstimator,
    context: FrameContext,
    object_id: int,
    pose_cam_obj: Float[np.ndarray, "4 4"],
    min_score: float | None,
) -> bool:
    """Whether an instance takes pixels: any does if no score is asked for."""
    if min_score is None:
        return True
    return estimator.score(context, object_id, pose_cam_obj) >= min_score


def _by_cost(found: Found) -> list[tuple[int, int]]:
    """Object and row of every instance, that of lowest cost first."""
    instances = [
        (float(refined.costs[row]), object_id, row)
        for object_id, refined in found.items()
        if refined is not None
        for row in refined.instances
    ]
    return [(object_id, row) for _, object_id, row in sorted(instances)]


def _left_by(
    estimator: PoseEstimator,
    left: Observation,
    found: Found,
    claims: Mapping[int, list[int]],
) -> Observation:
    """An image without what the instances in `claims` (rows by object) explain."""
    for object_id, rows in claims.items():
        for row in rows:
            refined = found[object_id]
            assert refined is not None
            pose = refined.refined[row].pose_cam_obj
            left = estimator.verifier(object_id).without_explained(left, pose)
    return left
