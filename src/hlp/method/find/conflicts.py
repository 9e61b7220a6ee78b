"""Objects of one frame compete for its pixels: what one pose explains supports no other."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.verification import Observation

Found = dict[int, RefinedHypotheses | None]
"""What stage 3 found, by object id; None where there was no hypothesis."""
SearchAgain = Callable[[int, Observation], RefinedHypotheses | None]
"""Searches an object once more in the pixels that others leave."""


def resolve_conflicts(
    estimator: PoseEstimator,
    context: FrameContext,
    found: Found,
    search_again: SearchAgain,
    min_score: float | None = None,
    unexplained: Observation | None = None,
) -> Found:
    """What was found of each object of a frame, without double claims.

    In order of cost, the instances of all objects that have at least `min_score` (None: all) take
    the pixels that they explain; in order of score where an object has no colours, because costs
    of different objects are then hardly comparable. If more than half of the pixels that agree with
    an instance are taken by other objects, its object is searched once more in what they leave.
    `unexplained` is the frame without what is known to be there (None: nothing is).
    """
    if sum(refined is not None for refined in found.values()) < 2:
        return found
    claims: dict[int, list[int]] = {}
    free = context.observation if unexplained is None else unexplained
    left, losers = free, []
    for object_id, row in _best_first(estimator, context, found):
        pose = _pose(found, object_id, row)
        counts = min_score is None or estimator.score(context, object_id, pose) >= min_score
        if object_id in losers or not counts:
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
        again = search_again(object_id, _left_by(estimator, free, resolved, others))
        resolved[object_id] = again
        claims[object_id] = [] if again is None else list(again.instances)
    return resolved


def _best_first(
    estimator: PoseEstimator, context: FrameContext, found: Found
) -> list[tuple[int, int]]:
    """Object and row of every instance, that of lowest cost or highest score first."""
    by_score = any(estimator.has_templates(object_id) for object_id in found)
    instances = []
    for object_id, refined in found.items():
        for row in () if refined is None else refined.instances:
            assert refined is not None
            rank = float(refined.costs[row])
            if by_score:
                rank = -estimator.score(context, object_id, _pose(found, object_id, row))
            instances.append((rank, object_id, row))
    return [(object_id, row) for _, object_id, row in sorted(instances)]


def _pose(found: Found, object_id: int, row: int) -> Float[np.ndarray, "4 4"]:
    refined = found[object_id]
    assert refined is not None
    return refined.refined[row].pose_cam_obj


def _left_by(
    estimator: PoseEstimator, left: Observation, found: Found, claims: Mapping[int, list[int]]
) -> Observation:
    """An image without what the instances in `claims` (rows by object) explain."""
    for object_id, rows in claims.items():
        for row in rows:
            pose = _pose(found, object_id, row)
            left = estimator.verifier(object_id).without_explained(left, pose)
    return left
