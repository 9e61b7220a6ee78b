"""How well poses fit a frame, and what they leave unexplained of it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from hlp.arrays import Image, Pose
from hlp.refinement.object_depth import ObjectDepth
from hlp.refinement.pose_fit import PoseFit, measure_fit
from hlp.refinement.score_model import ScoreModel, dullness_evidence
from hlp.refinement.verification import Observation, Verifier

Verifiers = Callable[[int], Verifier]
"""The verifier of an object, given its id."""
_NEARER = np.float32(0.5)  # of the object's distance: by far more than τ_d in front of it
_TOLERATED = 0.2  # share of a pose's pixels that surer ones explain better: parts touch (D)
_OF_OTHERS = 10.0  # of the logit, for each share beyond it (D)


class FrameFits:
    """The fits of poses in one frame, each measured once, and their scores.

    `verifier` and `score_model` are those of an object, given its id; `observation` is the frame.
    """

    def __init__(
        self,
        observation: Observation,
        verifier: Verifiers,
        score_model: Callable[[int], ScoreModel],
    ) -> None:
        self._observation, self._verifier = observation, verifier
        self._score_model = score_model
        self._known: dict[tuple[int, bytes], PoseFit] = {}
        self._settled: dict[tuple[int, bytes], float] = {}

    def measure(self, object_id: int, pose_cam_obj: Pose) -> PoseFit:
        """How well a pose fits the frame."""
        key = object_id, pose_cam_obj.tobytes()
        if key not in self._known:
            of = self._verifier(object_id), self._observation, pose_cam_obj
            self._known[key] = measure_fit(*of)
        return self._known[key]

    def score(self, object_id: int, pose_cam_obj: Pose) -> float:
        """The probability that a pose is right, by its fit."""
        return self._score_model(object_id).score(self.measure(object_id, pose_cam_obj))

    def score_alone(self, object_id: int, pose_cam_obj: Pose) -> float:
        """The same, whatever else the frame says of its look."""
        fit = replace(self.measure(object_id, pose_cam_obj), appearance=0.0)
        return self._score_model(object_id).score(fit)

    def set_appearance(self, object_id: int, pose_cam_obj: Pose, appearance: float) -> None:
        """Keep with a pose's fit what else the frame says of its look (`PoseFit.appearance`)."""
        fit = self.measure(object_id, pose_cam_obj)
        self._known[object_id, pose_cam_obj.tobytes()] = replace(fit, appearance=appearance)

    def doubt(self, object_id: int, poses_cam_obj: Sequence[Pose]) -> None:
        """Doubt poses of an object that may be absent from the frame, if it is dull."""
        if self._verifier(object_id).model.mesh.colored:
            for pose in poses_cam_obj:
                fit = self.measure(object_id, pose)
                self.set_appearance(object_id, pose, dullness_evidence(fit))

    def set_settled(self, object_id: int, pose_cam_obj: Pose, appearance: float) -> None:
        """Keep the appearance that a pose will have in the end (`settle`), once it is chosen."""
        self._settled[object_id, pose_cam_obj.tobytes()] = appearance

    def settle(self, instances: Sequence[tuple[int, Pose]]) -> None:
        """Give chosen instances their settled appearance, and tell objects without colours apart.

        Those that others hide are measured anew. What others hide by less than the verification
        tolerates is not seen, but it is no sign of a wrong pose either: the visible fraction stays.
        A pixel shows one part: of whose pixels surer ones explain many better is less likely right.
        Colours tell enough of other objects.
        """
        settled = [(each, pose.tobytes()) in self._settled for each, pose in instances]
        for object_id, pose in compress(instances, settled):
            self.set_appearance(object_id, pose, self._settled[object_id, pose.tobytes()])
        seen = self._observation
        colorless = [not self._verifier(each).model.mesh.colored for each, _ in instances]
        if len(instances) < 2 or not any(colorless):
            return
        # Only objects without colours are settled; those with colours speak against none.
        known = zip(instances, settled, strict=True)
        scores = [self.score(*instance) if has else 0.0 for instance, has in known]
        drawn = [self._verifier(each).depth_of(seen, pose) for each, pose in instances]
        for row, (object_id, pose) in enumerate(instances):
            if not colorless[row]:
                continue
            others = drawn[:row] + drawn[row + 1 :]
            before, fit = self.measure(object_id, pose), self._beside(object_id, pose, others)
            surer = [of for of, score in zip(drawn, scores, strict=True) if score > scores[row]]
            tolerance = self._verifier(object_id).tau_depth
            share = _explained_better(drawn[row], surer, seen.depth, tolerance)
            told = _OF_OTHERS * max(share - _TOLERATED, 0.0)
            if fit is not before or told > 0.0:
                fit = replace(fit, appearance=before.appearance - told)
                self._known[object_id, pose.tobytes()] = fit

    def _beside(self, object_id: int, pose: Pose, others: Sequence[ObjectDepth]) -> PoseFit:
        """The fit of a pose where others do not hide the object."""
        verifier, before = self._verifier(object_id), self.measure(object_id, pose)
        own, depth = verifier.depth_of(self._observation, pose), self._observation.depth.copy()
        hidden = own.hidden_by(others, depth)
        if not hidden.any():
            return before
        own.part(depth)[hidden] = _NEARER * own.depth[hidden]
        fit = measure_fit(verifier, replace(self._observation, depth=depth), pose)
        return replace(fit, visible_fraction=before.visible_fraction)


def _explained_better(
    own: ObjectDepth, others: Sequence[ObjectDepth], depth: Image, tolerance: float
) -> float:
    """Share of the pixels that agree with a pose that others explain better."""
    agreeing = own.explains(depth, tolerance)
    better = np.zeros_like(agreeing)
    for other in others:
        better |= own.worse_than(other, depth)
    return float(better[agreeing].sum() / max(agreeing.sum(), 1))


class Unexplained:
    """The part of a frame that poses leave unexplained, which they take one after another.

    `left` is where it begins; None: the whole frame.
    """

    def __init__(
        self, observation: Observation, verifier: Verifiers, left: Observation | None
    ) -> None:
        self._observation, self._verifier, self.left = observation, verifier, left

    @property
    def observation(self) -> Observation:
        """What is left."""
        return self._observation if self.left is None else self.left

    def is_free(self, object_id: int, pose: Pose) -> bool:
        """Whether at least half of the pixels that agree with a pose are left."""
        verifier = self._verifier(object_id)
        evidence = verifier.evidence(self._observation, pose[None])
        return bool(verifier.is_free(self.observation, pose[None], evidence)[0])

    def take(self, object_id: int, pose: Pose) -> None:
        """Leave out what a pose explains."""
        self.left = self._verifier(object_id).without_explained(self.observation, pose)
