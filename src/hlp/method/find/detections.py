"""What a detector says about an image: what it found, and why it did not find the rest."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool

from hlp.arrays import Pose, Poses
from hlp.geometry import rotation_distance, transform
from hlp.method.find.estimator import FrameContext
from hlp.method.find.trace import Trace
from hlp.records import Frame, ObjectModel
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit
from hlp.rendering.rasterizer import render_depth

_SAME_TURN = np.deg2rad(15.0)
_SAME_SHIFT = 0.1  # of the diameter
_DRAWN = 320  # px: width of the images that tell which instance lies on which
_OVERLAP = 0.02  # of the smaller silhouette: with less in common, none lies on the other


def plain(value: Any) -> Any:
    """A part of a detection as a value for JSON; what is not finite as None."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if not dataclasses.is_dataclass(value):
        return value
    return {part.name: plain(getattr(value, part.name)) for part in dataclasses.fields(value)}


@dataclass(frozen=True)
class RunnerUp:
    """The best other pose (4, 4) of an object, no equivalent of the chosen one, and its score.

    Examples:
        >>> found = detector.detect(rgb, depth, camera_matrix, ["bear"])[0]
        >>> found.runner_up.pose_cam_obj.shape
        (4, 4)
    """

    pose_cam_obj: Pose
    score: float


@dataclass(frozen=True)
class Detection:
    """One object found in one image.

    Attributes:
        object: its name.
        score: probability that the pose is right: that its ADD-S is below a tenth of the diameter.
        pose_cam_obj: (4, 4) float64, maps the object's coordinates to the camera's (metres; x
            right, y down, z forward).
        visible_fraction: part of the silhouette that is in the image and that nothing covers.
        seconds: wall time, divided equally among an object's instances; work shared by all objects
            of an image counts for the first. Threads search different objects at once, so that the
            times of objects overlap.
        residual_mm: median difference in depth (mm) where model and image agree.
        equivalent_poses: (n, 4, 4), the poses that the object's symmetries do not tell apart,
            `pose_cam_obj` first.
        runner_up: None if there was no other pose.
        fit: what the score is computed from.
        rank: place in the order in which a robot would pick what was found in the image, 0 first:
            what lies on another before it, else by score × visible fraction. None where it is not
            one of the answers for an image.

    Examples:
        >>> (found,) = detector.detect(rgb, depth, camera_matrix, ["bear"], max_instances=1)
        >>> print(found)
        bear: score ... at (...) mm, ...% visible
        >>> text = json.dumps(found.to_dict())
    """

    object: str
    score: float
    pose_cam_obj: Pose
    visible_fraction: float
    seconds: float
    residual_mm: float
    equivalent_poses: Poses
    runner_up: RunnerUp | None
    fit: PoseFit
    rank: int | None = field(default=None, kw_only=True)

    def __str__(self) -> str:
        """One line: object, score, position in the camera's coordinates and what is visible."""
        x, y, z = 1e3 * self.pose_cam_obj[:3, 3]
        return (
            f"{self.object}: score {self.score:.2f} at ({x:.1f}, {y:.1f}, {z:.1f}) mm, "
            f"{self.visible_fraction:.0%} visible"
        )

    def to_dict(self) -> dict[str, Any]:
        """Everything as values for JSON.

        Returns:
            Arrays as lists, `runner_up` and `fit` as dictionaries, what is not finite as None.
        """
        return {part.name: plain(getattr(self, part.name)) for part in dataclasses.fields(self)}


@dataclass(frozen=True)
class Rejection:
    """Why an object has no (other) detection: a sentence, and the best answer if there is one.

    Examples:
        >>> print(detector.search(rgb, depth, camera_matrix, ["bear"], 1, 1.0).rejections[0].reason)
        the score ... of the best pose is below 1
    """

    object: str
    reason: str
    answer: Detection | None


@dataclass(frozen=True)
class SearchResult:
    """Detections, the most certain first, and the answers that were not good enough.

    Examples:
        >>> detector.search(rgb, depth, camera_matrix, ["bear"]).detections[0].object
        'bear'
    """

    detections: list[Detection]
    rejections: list[Rejection]


@dataclass(frozen=True)
class TrackedDetection(Detection):
    """A detection in a sequence.

    `track` is the number of the instance, the same as in the frames before. `tracked` is True if
    the pose follows from the last one, False if the object was searched in the whole frame.

    Examples:
        >>> [(one.track, one.tracked) for one in detector.tracker(["bear"], 1).update(image)]
        [(0, False)]
    """

    track: int
    tracked: bool


@dataclass(frozen=True)
class TrackingResult:
    """What is in a frame, the most certain first, and why other objects are not found there.

    Examples:
        >>> detector.tracker(["bear"], 1).search(image).rejections
        []
    """

    detections: list[TrackedDetection]
    rejections: list[Rejection]


AnyDetection = TypeVar("AnyDetection", bound=Detection)


def with_ranks(
    detections: Sequence[AnyDetection], models: Mapping[int, ObjectModel], frame: Frame
) -> list[AnyDetection]:
    """The detections of one frame with their ranks, in the order in which they are given.

    Again and again, of those on which no other one lies, the one of the greatest product of score
    and visible fraction is picked; of all, if they lie on each other in a circle.
    """
    on_top = _lies_on(detections, {model.name: model for model in models.values()}, frame)
    values = np.array([found.score * found.visible_fraction for found in detections])
    left = np.ones(len(detections), dtype=bool)
    ranked = list(detections)
    for rank in range(len(detections)):
        free = left & ~on_top[left].any(axis=0)
        chosen = int(np.argmax(np.where(free if free.any() else left, values, -np.inf)))
        ranked[chosen] = replace(detections[chosen], rank=rank)
        left[chosen] = False
    return ranked


def _lies_on(
    detections: Sequence[Detection], models: Mapping[str, ObjectModel], frame: Frame
) -> Bool[np.ndarray, "n n"]:
    """Whether the first is nearer to the camera in most of what the silhouettes of two share."""
    height, width = frame.depth.shape
    scale = min(1.0, _DRAWN / width) if len(detections) > 1 else 0.0  # one alone is not drawn
    shape = math.ceil(height * scale), math.ceil(width * scale)
    camera_matrix = np.diag([scale, scale, 1.0]) @ frame.camera_matrix
    depths = np.zeros((len(detections), *shape), dtype=np.float32)
    for depth, found in zip(depths, detections, strict=True):
        mesh, pose = models[found.object].proxy, found.pose_cam_obj
        depth[:] = render_depth(mesh, pose[None], camera_matrix, shape, threads=1)[0]
    areas = np.count_nonzero(depths, axis=(1, 2))
    lies_on = np.zeros((len(detections), len(detections)), dtype=bool)
    for first, second in combinations(range(len(detections)), 2):
        both = (depths[first] > 0.0) & (depths[second] > 0.0)
        if np.count_nonzero(both) > _OVERLAP * min(areas[first], areas[second]):
            nearer = np.median((depths[first] - depths[second])[both]) < 0.0
            lies_on[(first, second) if nearer else (second, first)] = True
    return lies_on


def sort_answers(context: FrameContext, trace: Trace, min_score: float) -> SearchResult:
    """What a search of a frame found, divided by its score."""
    detections, rejections = list[Detection](), list[Rejection]()
    answers, models = describe_all(context, trace), context.estimator.learnt.models
    for answer in sorted(answers, key=lambda answer: -answer.score):
        if answer.score >= min_score:
            detections.append(answer)
        else:
            reason = f"the score {answer.score:.2f} of the best pose is below {min_score:g}"
            rejections.append(Rejection(answer.object, reason, answer))
    reason = "nothing looks like the object where the image has depth and no other object is found"
    missing = [models[i].name for i, found in trace.items() if found.refined is None]
    rejections += [Rejection(name, reason, None) for name in missing]
    return SearchResult(with_ranks(detections, models, context.frame), rejections)


def describe_all(context: FrameContext, trace: Trace) -> list[Detection]:
    """The instances that a search chose, object by object, with all that is known of them."""
    ids = [*trace]

    def describe_object(place: int) -> list[Detection]:
        found = trace[ids[place]]
        return describe(context, ids[place], found.refined, sum(found.seconds.values()))

    described = context.estimator.team.map(describe_object, len(ids))
    return [detection for of_object in described for detection in of_object]


def describe(
    context: FrameContext, object_id: int, refined: RefinedHypotheses | None, seconds: float = 0.0
) -> list[Detection]:
    """The instances that stage 3 chose, with all that is known of them."""
    if refined is None:
        return []
    described = []
    for row, pose in zip(refined.instances, refined.chosen_poses, strict=True):
        found = describe_pose(context, object_id, pose)
        other = _runner_up(context, object_id, refined, row)
        described.append(replace(found, seconds=seconds / len(refined.instances), runner_up=other))
    return described


def describe_pose(context: FrameContext, object_id: int, pose_cam_obj: Pose) -> Detection:
    """One pose of an object, without a runner-up and in no time."""
    model = context.estimator.learnt.models[object_id]
    fit = context.fits.measure(object_id, pose_cam_obj)
    score = context.fits.score(object_id, pose_cam_obj)
    depth, same = fit.residual_mm, pose_cam_obj @ model.symmetries
    return Detection(
        model.name, score, pose_cam_obj, fit.visible_fraction, 0.0, depth, same, None, fit
    )


def _runner_up(
    context: FrameContext, object_id: int, refined: RefinedHypotheses, chosen: int
) -> RunnerUp | None:
    model = context.estimator.learnt.models[object_id]
    poses = np.stack([found.pose_cam_obj for found in refined.refined])
    alike = poses[chosen] @ model.symmetries
    centers = transform(poses, model.centroid[None])[:, 0]
    far = np.linalg.norm(centers - centers[chosen], axis=1) > _SAME_SHIFT * model.diameter
    angles = rotation_distance(poses[:, None, :3, :3], alike[None, :, :3, :3]).min(axis=1)
    other = np.flatnonzero(far | (angles > _SAME_TURN))
    other = other[~np.isin(other, refined.instances)]
    if len(other) == 0:
        return None
    pose = poses[other[np.argmin(refined.costs[other])]]
    return RunnerUp(pose, context.fits.score(object_id, pose))
