"""Stages 2 and 3 of one object, until its instances are found: the region first, then closer."""

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
) -> RefinedHypotheses | None:
    """What `PoseEstimator.refine` finds and, where that is not enough, a closer look.

    `hypotheses` are those of the `region`. While fewer than `instances` poses are right with a
    probability of a half, the likeliest places of the region are searched, a few at a time. With
    `min_score` the number of instances is not known: then one pose with that score, and of a half
    at least, is enough. A pose from a closer look has no coarse hypothesis: its source is -1.
    """
    object_id = region.object_id
    # Whoever wants to see improbable poses too does not want to find worse ones.
    enough = max(MIN_SCORE, min_score or 0.0)
    looks = _Looks(estimator, context, object_id, enough)
    improbable = min_score is not None and min_score < enough
    looks.add(estimator.refine(context, object_id, hypotheses, instances, unexplained, min_score))
    for closer in estimator.closer_regions(context, region):
        right = looks.right()
        if len(right) >= instances or (right and min_score is not None):
            break
        left = unexplained
        for pose in right:
            before = context.observation if left is None else left
            left = estimator.verifier(object_id).without_explained(before, pose)
        coarse = estimator.find_hypotheses(context, closer)
        missing = instances - len(right)
        looks.add(
            estimator.refine(context, object_id, coarse.hypotheses, missing, left, min_score),
            closer=True,
        )
    return looks.together(instances, improbable)


class _Looks:
    """What each look at the frame found, the first one being that at the whole region."""

    def __init__(
        self, estimator: PoseEstimator, context: FrameContext, object_id: int, enough: float
    ) -> None:
        self._score = partial(estimator.score, context, object_id)
        self._enough = enough
        self._found: list[RefinedHypotheses] = []
        self._scores: list[list[float]] = []

    def add(self, found: RefinedHypotheses | None, closer: bool = False) -> None:
        """Add what the next look found; a `closer` one has hypotheses of its own."""
        if found is None:
            return
        if closer:
            found = replace(found, sources=np.full_like(found.sources, -1))
        self._found.append(found)
        self._scores.append([self._score(found.refined[i].pose_cam_obj) for i in found.instances])

    def right(self) -> list[Float[np.ndarray, "4 4"]]:
        """The poses that are probably right."""
        return [
            found.refined[row].pose_cam_obj
            for found, scores in zip(self._found, self._scores, strict=True)
            for row, score in zip(found.instances, scores, strict=True)
            if score >= self._enough
        ]

    def together(self, instances: int, improbable: bool) -> RefinedHypotheses | None:
        """All looks as one: the probably right instances, then the best others of one look.

        Where `improbable` poses are answers too, the others are from a look that found a right one,
        if any did: from another look, they might be worse poses of the same instance.
        """
        if len(self._found) < 2:
            return self._found[0] if self._found else None
        starts = np.cumsum([0, *(len(found.refined) for found in self._found)])
        right, others = list[int](), list[list[tuple[float, int]]]()
        for start, found, scores in zip(starts, self._found, self._scores, strict=False):
            rows = [int(start) + row for row in found.instances]
            ranked = sorted(zip(scores, rows, strict=True), key=lambda each: -each[0])
            right += [row for score, row in ranked if score >= self._enough]
            others.append([each for each in ranked if each[0] < self._enough])
        if improbable and right:
            found_right = [any(each >= self._enough for each in scores) for scores in self._scores]
            others = list(itertools.compress(others, found_right))
        best = max(others, key=lambda each: each[0][0] if each else -1.0)
        chosen = (right + [row for _, row in best])[: max(instances, len(right))]
        return RefinedHypotheses(
            [each for found in self._found for each in found.refined],
            np.concatenate([found.costs for found in self._found]),
            np.concatenate([found.sources for found in self._found]),
            tuple(chosen),
        )
