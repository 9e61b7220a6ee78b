"""Which poses are instances: of one object until enough are found, then of all objects of a frame.

What one pose explains supports no other.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.score_model import MIN_SCORE, SURE
from hlp.refinement.verification import Observation

Pose = Float[np.ndarray, "4 4"]
Found = dict[int, RefinedHypotheses | None]
"""What stage 3 found, by object id; None where there was no hypothesis."""
SearchAgain = Callable[[int, Observation], RefinedHypotheses | None]
"""Searches an object once more in the pixels that others leave."""


class Unexplained:
    """The part of a frame that poses leave unexplained, which they take one after another.

    `left` is where it begins; None: the whole frame.
    """

    def __init__(
        self, estimator: PoseEstimator, context: FrameContext, left: Observation | None
    ) -> None:
        self._estimator, self._context, self.left = estimator, context, left

    @property
    def observation(self) -> Observation:
        """What is left."""
        return self._context.observation if self.left is None else self.left

    def is_free(self, object_id: int, pose: Pose) -> bool:
        """Whether at least half of the pixels that agree with a pose are left."""
        verifier = self._estimator.verifier(object_id)
        evidence = verifier.evidence(self._context.observation, pose[None])
        return bool(verifier.is_free(self.observation, pose[None], evidence)[0])

    def take(self, object_id: int, pose: Pose) -> None:
        """Leave out what a pose explains."""
        self.left = self._estimator.verifier(object_id).without_explained(self.observation, pose)


def find_instances(
    estimator: PoseEstimator,
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
    `min_score` the number of instances is not known: then one pose with that score, and of a half
    at least, is enough. A pose from the fallback has no coarse hypothesis: its source is -1.
    """
    object_id = region.object_id
    first = estimator.refine(context, object_id, hypotheses, instances, unexplained, min_score)
    if not fallback:
        return first
    attempts = _Attempts(estimator, context, object_id, unexplained)
    attempts.add(first)
    for enough, coarse_poses in _further_looks(estimator, context, region):
        # A low min_score asks for improbable poses too; it must not skip the fallback.
        right = [
            pose for score, _, pose in attempts.different() if score >= max(enough, min_score or 0)
        ]
        if len(right) >= instances or (right and min_score is not None):
            break
        rest = Unexplained(estimator, context, unexplained)
        for pose in right:
            rest.take(object_id, pose)
        missing = instances - len(right)
        coarse = coarse_poses(missing, rest.left)
        found = estimator.refine(context, object_id, coarse, missing, rest.left, min_score)
        if found is not None:
            attempts.add(replace(found, sources=np.full_like(found.sources, -1)))
    return attempts.merged(instances)


def _further_looks(
    estimator: PoseEstimator, context: FrameContext, region: Region
) -> Iterator[tuple[float, Callable[[int, Observation | None], Hypotheses]]]:
    """Further sources of coarse poses, given the missing instances and what is unexplained.

    With each, the score of a pose that makes it needless: votes may be fooled by what is flat, so
    templates are asked wherever they are not sure.
    """
    if estimator.has_templates(region.object_id):
        yield SURE, partial(estimator.match_templates, context, region.object_id)
    for places in estimator.likely_regions(context, region):
        yield MIN_SCORE, partial(_votes_in, estimator, context, places)


def _votes_in(
    estimator: PoseEstimator, context: FrameContext, places: Region, *_: object
) -> Hypotheses:
    found = estimator.find_hypotheses(context, places).hypotheses
    assert found is not None
    return found


class _Attempts:
    """What each search of a part of the frame has found, the region being the first part."""

    def __init__(
        self,
        estimator: PoseEstimator,
        context: FrameContext,
        object_id: int,
        unexplained: Observation | None,
    ) -> None:
        self._estimator, self._context = estimator, context
        self._object_id, self._unexplained = object_id, unexplained
        self._found: list[RefinedHypotheses] = []
        self._answers: list[tuple[float, int, Pose]] = []  # score, row of all, pose

    def add(self, found: RefinedHypotheses | None) -> None:
        """Add what the next search found."""
        if found is None:
            return
        start = sum(len(before.refined) for before in self._found)
        self._found.append(found)
        for row, pose in zip(found.instances, found.chosen_poses, strict=True):
            score = self._estimator.score(self._context, self._object_id, pose)
            self._answers.append((score, start + row, pose))

    def different(self) -> list[tuple[float, int, Pose]]:
        """The answers, the most probable first, without those on pixels of better ones."""
        kept: list[tuple[float, int, Pose]] = []
        rest = Unexplained(self._estimator, self._context, self._unexplained)
        for answer in sorted(self._answers, key=lambda answer: -answer[0]):
            if not kept or rest.is_free(self._object_id, answer[2]):
                kept.append(answer)
                rest.take(self._object_id, answer[2])
        return kept

    def merged(self, instances: int) -> RefinedHypotheses | None:
        """All attempts as one: of all answers the best, each of another instance."""
        if len(self._found) < 2:
            return self._found[0] if self._found else None
        return RefinedHypotheses(
            [pose for found in self._found for pose in found.refined],
            np.concatenate([found.costs for found in self._found]),
            np.concatenate([found.sources for found in self._found]),
            np.concatenate([found.seeds for found in self._found]),
            tuple(row for _, row, _ in self.different()[:instances]),
        )


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
    claims: dict[int, list[Pose]] = {}
    rest, losers = Unexplained(estimator, context, unexplained), []
    for object_id, pose in _best_first(estimator, context, found):
        counts = min_score is None or estimator.score(context, object_id, pose) >= min_score
        if object_id in losers or not counts:
            continue
        if rest.is_free(object_id, pose):
            rest.take(object_id, pose)
            claims.setdefault(object_id, []).append(pose)
        else:
            losers.append(object_id)
    resolved = dict(found)
    for object_id in losers:
        rest = Unexplained(estimator, context, unexplained)
        for other, poses in claims.items():
            for pose in poses if other != object_id else ():
                rest.take(other, pose)
        again = search_again(object_id, rest.observation)
        resolved[object_id] = again
        claims[object_id] = [] if again is None else again.chosen_poses
    return resolved


def _best_first(
    estimator: PoseEstimator, context: FrameContext, found: Mapping[int, RefinedHypotheses | None]
) -> list[tuple[int, Pose]]:
    """Object and pose of every instance, that of lowest cost or highest score first."""
    by_score = any(estimator.has_templates(object_id) for object_id in found)
    instances = []
    for object_id, refined in found.items():
        if refined is not None:
            for row, pose in zip(refined.instances, refined.chosen_poses, strict=True):
                cost = float(refined.costs[row])
                rank = -estimator.score(context, object_id, pose) if by_score else cost
                instances.append((rank, object_id, row, pose))
    return [(object_id, pose) for _, object_id, _, pose in sorted(instances, key=lambda i: i[:3])]
