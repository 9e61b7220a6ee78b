"""One instance of an object from frame to frame: its hypotheses, and its pose in the next frame."""

from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge, Interval
from jaxtyping import Float

from hlp.geometry import nearest_rotation, project, rigid, transform
from hlp.method.find.detections import Detection, Rejection, describe
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.method.find.patch_matching import FrameMatches
from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.refiner import refinable
from hlp.refinement.score_model import MIN_SCORE
from hlp.refinement.verification import Observation
from hlp.rendering.rasterizer import NEAR
from hlp.settings import Doc, Settings

# Diameters beside an object that are looked at: the search moves it by less.
_BESIDE = 0.5


@dataclass(frozen=True, kw_only=True)
class TrackingSettings(Settings):
    """How objects are followed through a sequence of frames."""

    min_score: Annotated[
        float,
        Interval(ge=0, le=1),
        Doc(
            "probability below which a tracked pose is lost, so that the object is detected again "
            "in that frame, and below which a detected pose is no answer (D)"
        ),
    ] = MIN_SCORE
    search_every: Annotated[
        int,
        Ge(0),
        Doc(
            "frames between two searches for more instances of an object that is tracked; "
            "0: none. An object that is not tracked is searched in every frame (D)"
        ),
    ] = 30
    prediction: Annotated[
        bool, Doc("start also from where the object is if it has moved on as before (D)")
    ] = True


@dataclass(frozen=True)
class TrackedDetection(Detection):
    """A detection in a sequence.

    `track` is the number of the instance, the same as in the frames before. `tracked` is True if
    the pose follows from the last one, False if the object was searched in the whole frame.
    """

    track: int
    tracked: bool


@dataclass(frozen=True)
class TrackingResult:
    """What is in a frame, the most certain first, and why other objects are not found there."""

    detections: list[TrackedDetection]
    rejections: list[Rejection]


@dataclass(frozen=True)
class Track:
    """One instance as it was last seen: its number, its pose, and the pose in the frame before.

    `before` is None unless the instance was tracked from that frame on.
    """

    number: int
    object_id: int
    score: float
    pose_cam_obj: Float[np.ndarray, "4 4"]
    before: Float[np.ndarray, "4 4"] | None = None

    def start_poses(
        self, centroid: Float[np.ndarray, "3"], prediction: bool
    ) -> Float[np.ndarray, "n 4 4"]:
        """Where the next frame may show the instance: at its pose, or moved on by one more step.

        A step turns about the object's centroid (object coordinates, m) and shifts it.
        """
        # Products of rotations drift away from rotations within some thousand frames.
        last = self.pose_cam_obj.copy()
        last[:3, :3] = nearest_rotation(last[:3, :3])
        if self.before is None or not prediction:
            return last[None]
        turn = last[:3, :3] @ self.before[:3, :3].T
        rotation = nearest_rotation(turn @ last[:3, :3])
        now, then = (transform(pose, centroid[None])[0] for pose in (last, self.before))
        predicted = rigid(rotation, 2.0 * now - then - rotation @ centroid)
        return np.stack([last, predicted])


def follow(
    estimator: PoseEstimator,
    context: FrameContext,
    track: Track,
    unexplained: Observation | None,
    settings: TrackingSettings,
) -> Detection | None:
    """The best answer about where the instance was; None if other instances explain all of it.

    Start poses are followed in order of their cost, until one has a good score. If none has, they
    are refined as hypotheses are, which finds poses that are farther away.
    """
    object_id = track.object_id
    model, verifier = estimator.learnt.models[object_id], estimator.verifier(object_id)
    starts = track.start_poses(model.centroid, settings.prediction)
    starts = starts[refinable(starts, model.centroid)]
    near = part_near(estimator, context, model, starts)
    if len(starts) > 1:
        starts = starts[np.argsort(verifier.costs(near.observation, starts), kind="stable")]
    answers = list[Detection]()
    for start in starts:
        pose = estimator.follow(near, object_id, start)
        if unexplained is not None:
            evidence = verifier.evidence(near.observation, pose[None])
            if not verifier.is_free(unexplained, pose[None], evidence)[0]:
                continue
        no_source, no_seed = np.zeros(1, dtype=int), np.zeros((1, 2), dtype=int)
        one = RefinedHypotheses([Refinement(pose, 0)], np.zeros(1), no_source, no_seed, (0,))
        answers += describe(estimator, near, object_id, one, 0.0)
        if answers[-1].score >= settings.min_score:
            return answers[-1]
    all_starts = Hypotheses(starts, np.ones(len(starts)))
    refined = estimator.refine(context, object_id, all_starts, 1, unexplained)
    if refined is not None:
        answers += describe(estimator, context, object_id, refined, 0.0)
    return max(answers, key=lambda each: each.score, default=None)


def part_near(
    estimator: PoseEstimator,
    context: FrameContext,
    model: ObjectModel,
    poses_cam_obj: Float[np.ndarray, "n 4 4"],
) -> FrameContext:
    """The part of the frame that shows the object in any of some poses, and what is beside it.

    Preparing the whole frame would take longer than following one object in it. The part has pixel
    coordinates of its own; the windows are those of the whole frame, so objects are not to be
    detected in a part.
    """
    frame = context.frame
    points = transform(poses_cam_obj, model.proxy.vertices).reshape(-1, 3)
    if len(points) == 0 or points[:, 2].min() <= NEAR:
        return context
    beside = _BESIDE * model.diameter * frame.camera_matrix[0, 0] / points[:, 2].min()
    pixels = project(points, frame.camera_matrix)
    size = frame.depth.shape[1], frame.depth.shape[0]
    low = np.clip(np.floor(pixels.min(axis=0) - beside), 0, size).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0) + beside), 0, size).astype(int)
    if (high <= low).any():
        return context
    area = slice(low[1], high[1]), slice(low[0], high[0])
    camera_matrix = frame.camera_matrix.copy()
    camera_matrix[:2, 2] -= low
    part = replace(frame, rgb=frame.rgb[area], depth=frame.depth[area], camera_matrix=camera_matrix)
    matches = FrameMatches(estimator.matching, part)
    return FrameContext(
        part, context.windows, matches, estimator.settings.fine.refinement.verification
    )


def numbered(detection: Detection, number: int, tracked: bool) -> TrackedDetection:
    """A detection as one of an instance that has a number."""
    values = {each.name: getattr(detection, each.name) for each in fields(Detection)}
    return TrackedDetection(**values, track=number, tracked=tracked)
