"""Which poses are instances: of one object until enough are found, then of all objects of a frame.

What one pose explains supports no other.
"""

from collections.abc import Callable, Iterator
from functools import partial

from hlp.arrays import Pose
from hlp.method.find.attempts import Attempts, CoarsePoses
from hlp.method.find.estimator import FrameContext
from hlp.method.find.frame_fits import Unexplained
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.score_model import MIN_SCORE, SURE
from hlp.refinement.verification import Observation

Found = dict[int, RefinedHypotheses | None]
"""What stage 3 found, by object id; None where there was no hypothesis."""
SearchAgain = Callable[[int, Observation], RefinedHypotheses | None]
"""Searches an object once more in the pixels that others leave."""


def find_instances(
    context: FrameContext,
    region: Region,
    hypotheses: Hypotheses,
    instances: int = 1,
    unexplained: Observation | None = None,
    min_score: float | None = None,
    *,
    fallback: bool = True,
) -> RefinedHypotheses | None:
    """What `PoseEstimator.refine` finds and, with `fallback`, what is found at likely places.

    `hypotheses` are those of the `region`. While fewer than `instances` poses are right with a
    probability of a half, the likeliest places of the region are searched, a few at a time. With
    `min_score` the number of instances is not known: then templates are asked for more of them, as
    long as they find some, and one pose with that score, and of a half at least, is enough. A pose
    from the fallback has no coarse hypothesis: its source is -1.
    """
    object_id, estimator = region.object_id, context.estimator
    first = estimator.refine(context, object_id, hypotheses, instances, unexplained, min_score)
    if not fallback:
        return first
    attempts = Attempts(context, object_id, instances, unexplained, min_score)
    attempts.add(first)
    attempts.search_neighbours()
    for enough, coarse_poses in _fallback_sources(context, region, min_score is None):
        # A low min_score asks for improbable poses too; it must not skip the fallback.
        right = attempts.poses(max(enough, min_score or 0))
        if len(right) >= instances or (right and min_score is not None and enough < SURE):
            break
        attempts.search_further(coarse_poses, right)
        attempts.search_neighbours()
        if enough == SURE and min_score is not None:
            attempts.search_rest(coarse_poses, right)
    attempts.search_instead()
    return attempts.merged()


def _fallback_sources(
    context: FrameContext, region: Region, known: bool
) -> Iterator[tuple[float, CoarsePoses]]:
    """Further sources of coarse poses, given the missing instances and what is unexplained.

    With each, the score of a pose that makes it needless: votes may be fooled by what is flat, so
    templates are asked wherever they are not sure.
    """
    estimator = context.estimator
    if estimator.has_templates(region.object_id):
        yield SURE, partial(estimator.match_templates, context, region.object_id)
    for places in estimator.other_regions(context, region, known):
        yield MIN_SCORE, partial(_votes_in, context, places)


def _votes_in(context: FrameContext, places: Region, *_: object) -> Hypotheses:
    found = context.estimator.find_hypotheses(context, places).hypotheses
    assert found is not None
    return found


def resolve_conflicts(
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
    claims: dict[int, list[Pose]] = {}
    whole = context.observation, context.estimator.verifier, unexplained
    rest, losers = Unexplained(*whole), []
    for object_id, pose in _best_first(context, found):
        counts = min_score is None or context.fits.score(object_id, pose) >= min_score
        if not counts:
            continue
        if rest.is_free(object_id, pose):
            rest.take(object_id, pose)
            claims.setdefault(object_id, []).append(pose)
        elif object_id not in losers:
            losers.append(object_id)
    resolved = dict(found)
    for object_id in losers:
        rest = Unexplained(*whole)
        for other, poses in claims.items():
            for pose in poses if other != object_id else ():
                rest.take(other, pose)
        context.barren.pop(object_id, None)  # what it took itself is left again
        again = search_again(object_id, rest.observation)
        resolved[object_id] = again
        claims[object_id] = [] if again is None else again.chosen_poses
    return resolved


def _best_first(context: FrameContext, found: Found) -> list[tuple[int, Pose]]:
    """Object and pose of every instance, that of lowest cost or highest score first."""
    estimator = context.estimator
    by_score = any(estimator.has_templates(object_id) for object_id in found)
    instances = []
    for object_id, refined in found.items():
        if refined is not None:
            for row, pose in zip(refined.instances, refined.chosen_poses, strict=True):
                cost = float(refined.costs[row])
                rank = -context.fits.score(object_id, pose) if by_score else cost
                instances.append((rank, object_id, row, pose))
    return [(object_id, pose) for _, object_id, _, pose in sorted(instances, key=lambda i: i[:3])]
