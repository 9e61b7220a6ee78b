"""Stage 3 of one object until its instances are found: in its region, then at likely places."""

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.score_model import MIN_SCORE
from hlp.refinement.verification import Observation


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
    # A low min_score asks for improbable poses too; it must not skip the fallback.
    enough = max(MIN_SCORE, min_score or 0.0)
    attempts = _Attempts(estimator, context, object_id, enough)
    attempts.add(first)
    for places in estimator.likely_regions(context, region):
        right = attempts.right()
        if len(right) >= instances or (right and min_score is not None):
            break
        left = unexplained
        for pose in right:
            before = context.observation if left is None else left
            left = estimator.verifier(object_id).without_explained(before, pose)
        coarse = estimator.find_hypotheses(context, places)
        missing = instances - len(right)
        attempts.add(
            estimator.refine(context, object_id, coarse.hypotheses, missing, left, min_score),
            in_region=False,
        )
    return attempts.merged(instances, min_score is not None and min_score < enough)


class _Attempts:
    """What each search of a part of the frame has found, the region being the first part."""

    def __init__(
        self, estimator: PoseEstimator, context: FrameContext, object_id: int, enough: float
    ) -> None:
        self._score = partial(estimator.score, context, object_id)
        self._enough = enough
        self._found: list[RefinedHypotheses] = []
        self._scores: list[list[float]] = []

    def add(self, found: RefinedHypotheses | None, in_region: bool = True) -> None:
        """Add what the next search found, in the region or elsewhere."""
        if found is None:
            return
        if not in_region:
            found = replace(found, sources=np.full_like(found.sources, -1))
        self._found.append(found)
        self._scores.append([self._score(pose) for pose in found.chosen_poses])

    def right(self) -> list[Float[np.ndarray, "4 4"]]:
        """The poses that are probably right."""
        return [
            pose
            for found, scores in zip(self._found, self._scores, strict=True)
            for pose, score in zip(found.chosen_poses, scores, strict=True)
            if score >= self._enough
        ]

    def merged(self, instances: int, improbable: bool) -> RefinedHypotheses | None:
        """All attempts as one: the probably right instances, then the best others of one attempt.

        Where `improbable` poses are answers too, the others are from an attempt that found a right
        one, if any did: from another, they might be worse poses of the same instance.
        """
        if len(self._found) < 2:
            return self._found[0] if self._found else None
        starts = np.cumsum([0, *(len(found.refined) for found in self._found)])
        right, others = list[int](), list[list[tuple[float, int]]]()
        for start, found, scores in zip(starts, self._found, self._scores, strict=False):
            rows = [int(start) + row for row in found.instances]
            ranked = sorted(zip(scores, rows, strict=True), key=lambda pair: -pair[0])
            right += [row for score, row in ranked if score >= self._enough]
            others.append([pair for pair in ranked if pair[0] < self._enough])
        if improbable and right:
            found_right = [any(s >= self._enough for s in scores) for scores in self._scores]
            others = list(itertools.compress(others, found_right))
        best = max(others, key=lambda ranked: ranked[0][0] if ranked else -1.0)
        chosen = (right + [row for _, row in best])[: max(instances, len(right))]
        return RefinedHypotheses(
            [pose for found in self._found for pose in found.refined],
            np.concatenate([found.costs for found in self._found]),
            np.concatenate([found.sources for found in self._found]),
            np.concatenate([found.seeds for found in self._found]),
            tuple(chosen),
        )
