"""How well poses fit a frame, and what they leave unexplained of it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hlp.arrays import Pose
from hlp.refinement.pose_fit import PoseFit, measure_fit
from hlp.refinement.score_model import ScoreModel
from hlp.refinement.verification import Observation, Verifier

Verifiers = Callable[[int], Verifier]
"""The verifier of an object, given its id."""
_NEARER = np.float32(0.5)  # of the object's distance: by far more than τ_d in front of it


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

    def set_settled(self, object_id: int, pose_cam_obj: Pose, appearance: float) -> None:
        """Keep the appearance that a pose will have in the end (`settle`), once it is chosen."""
        self._settled[object_id, pose_cam_obj.tobytes()] = appearance

    def settle(self, instances: Sequence[tuple[int, Pose]]) -> None:
        """Give chosen instances their settled appearance, measure those anew that others hide.

        The latter holds for objects without colours. What others hide by less than the verification
        tolerates is not seen, but it is no sign of a wrong pose either: the visible fraction stays.
        Colours tell enough of other objects.
        """
        for object_id, pose in instances:
            if (object_id, pose.tobytes()) in self._settled:
                settled = self._settled[object_id, pose.tobytes()]
                self.set_appearance(object_id, pose, settled)
        seen = self._observation
        colorless = [not self._verifier(each).model.mesh.colored for each, _ in instances]
        if len(instances) < 2 or not any(colorless):
            return
        drawn = [self._verifier(each).depth_of(seen, pose) for each, pose in instances]
        for row, (object_id, pose) in enumerate(instances):
            own, others, depth = drawn[row], drawn[:row] + drawn[row + 1 :], seen.depth.copy()
            hidden = own.hidden_by(others, depth)
            if not (colorless[row] and hidden.any()):
                continue
            own.part(depth)[hidden] = _NEARER * own.depth[hidden]
            before = self.measure(object_id, pose)
            self._known[object_id, pose.tobytes()] = replace(
                measure_fit(self._verifier(object_id), replace(seen, depth=depth), pose),
                appearance=before.appearance,
                visible_fraction=before.visible_fraction,
            )


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
