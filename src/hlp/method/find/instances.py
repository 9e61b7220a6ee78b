"""Stage 3 of one object until its instances are found: in its region, then at likely places."""

from collections.abc import Callable, Iterator, Sequence
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
        right = attempts.right(max(enough, min_score or 0.0))
        if len(right) >= instances or (right and min_score is not None):
            break
        left = attempts.without(right)
        missing = instances - len(right)
        coarse = coarse_poses(missing, left)
        found = estimator.refine(context, object_id, coarse, missing, left, min_score)
        attempts.add(found, in_region=False)
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
        yield MIN_SCORE, partial(_votes_of, estimator, context, places)


def _votes_of(
    estimator: PoseEstimator, context: FrameContext, places: Region, _: int, __: Observation | None
) -> Hypotheses:
    return estimator.find_hypotheses(context, places).hypotheses


class _Attempts:
    """What each search of a part of the frame has found, the region being the first part."""

    def __init__(
        self,
        estimator: PoseEstimator,
        context: FrameContext,
        object_id: int,
        unexplained: Observation | None,
    ) -> None:
        self._score = partial(estimator.score, context, object_id)
        self._verifier = estimator.verifier(object_id)
        self._context, self._unexplained = context, unexplained
        self._found: list[RefinedHypotheses] = []
        self._answers: list[tuple[float, int, Pose]] = []  # score, row of all, pose

    def add(self, found: RefinedHypotheses | None, in_region: bool = True) -> None:
        """Add what the next search found, in the region or elsewhere."""
        if found is None:
            return
        if not in_region:
            found = replace(found, sources=np.full_like(found.sources, -1))
        start = sum(len(before.refined) for before in self._found)
        self._found.append(found)
        for row, pose in zip(found.instances, found.chosen_poses, strict=True):
            self._answers.append((self._score(pose), start + row, pose))

    def right(self, enough: float) -> list[Pose]:
        """Poses of different instances with at least this score."""
        return [pose for score, _, pose in self._different() if score >= enough]

    def without(self, poses: Sequence[Pose]) -> Observation | None:
        """What these poses leave unexplained."""
        left = self._unexplained
        for pose in poses:
            before = self._context.observation if left is None else left
            left = self._verifier.without_explained(before, pose)
        return left

    def merged(self, instances: int) -> RefinedHypotheses | None:
        """All attempts as one: of all answers the best, each of another instance."""
        if len(self._found) < 2:
            return self._found[0] if self._found else None
        chosen = [row for _, row, _ in self._different()[:instances]]
        return RefinedHypotheses(
            [pose for found in self._found for pose in found.refined],
            np.concatenate([found.costs for found in self._found]),
            np.concatenate([found.sources for found in self._found]),
            np.concatenate([found.seeds for found in self._found]),
            tuple(chosen),
        )

    def _different(self) -> list[tuple[float, int, Pose]]:
        """The answers, the most probable first, without those on pixels of better ones."""
        kept: list[tuple[float, int, Pose]] = []
        left = self._unexplained
        for answer in sorted(self._answers, key=lambda answer: -answer[0]):
            pose = answer[2]
            if kept:
                evidence = self._verifier.evidence(self._context.observation, pose[None])
                assert left is not None
                if not self._verifier.is_free(left, pose[None], evidence)[0]:
                    continue
            kept.append(answer)
            before = self._context.observation if left is None else left
            left = self._verifier.without_explained(before, pose)
        return kept
