"""Objects through a sequence of frames: followed from pose to pose, detected where that fails."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from hlp.arrays import Mask, Pose, Poses, Vector
from hlp.geometry import nearest_rotation, nearest_symmetric_pose, project, rigid, transform
from hlp.method.arguments import RgbdFrame, checked_mask, checked_rgbd
from hlp.method.find.detections import (
    Detection,
    Rejection,
    TrackedDetection,
    TrackingResult,
    describe,
    describe_pose,
    sort_answers,
    with_ranks,
)
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.method.find.frame_fits import Unexplained
from hlp.method.find.patch_matching import FrameMatches
from hlp.method.find.search import search_frame
from hlp.method.settings import TrackingSettings
from hlp.records import Hypotheses, ObjectModel
from hlp.refinement.refiner import refinable
from hlp.refinement.verification import Observation
from hlp.rendering.rasterizer import NEAR

_BESIDE = 0.5  # diameters beside an object that are looked at: the search moves it by less


class Tracker:
    """Follows objects from frame to frame. Made by `Detector.tracker`.

    An instance that was found in the last frame is looked for where it was, by the refiner alone.
    If its score is then too low, its object is detected again in the same frame. Of the poses that
    its symmetries do not tell apart it keeps to one. Frames are taken to be equally far apart in
    time. A tracker belongs to one sequence; several trackers may use one detector.

    Examples:
        >>> tracker = detector.tracker(["bear"], max_instances=1)
        >>> for frame in [image, image]:
        ...     for found in tracker.update(frame):
        ...         print(found.track, found.tracked, found)
        0 False bear: score ... visible
        0 True bear: score ... visible
    """

    def __init__(
        self,
        estimator: Callable[[], AbstractContextManager[PoseEstimator]],
        object_ids: Sequence[int],
        max_instances: int,
        settings: TrackingSettings,
    ) -> None:
        """`estimator` lends the estimator for the time of one frame."""
        self._estimator, self._object_ids = estimator, tuple(object_ids)
        self._max_instances, self.settings = max_instances, settings
        self.reset()

    def reset(self) -> None:
        """Forget all poses: the next frame is searched as the first one was.

        Examples:
            >>> tracker = detector.tracker(["bear"], max_instances=1)
            >>> found = tracker.update(image)
            >>> tracker.reset()
            >>> [one.tracked for one in tracker.update(image)]
            [False]
        """
        self._tracks: tuple[Track, ...] = ()
        self._since_search: dict[int, int] = {}
        self._numbers = count()

    def update(self, frame: RgbdFrame, mask: Mask | None = None) -> list[TrackedDetection]:
        """Find the objects in the next frame.

        Args:
            frame: has `rgb`, `depth` and `camera_matrix` as in `Detector.detect`.
            mask: (h, w) bool, narrows the search for objects that are not tracked.

        Returns:
            What is found, the most certain first; in the first frame as by `Detector.detect`.

        Raises:
            InputError: the frame is wrong. The tracker then is as it was before.
        """
        return self.search(frame, mask).detections

    def search(self, frame: RgbdFrame, mask: Mask | None = None) -> TrackingResult:
        """Find objects as `update` does, and say of each that is not found, why.

        Args:
            frame: as in `update`.
            mask: as in `update`.

        Returns:
            Detections, and the rejected answers with the reasons.

        Raises:
            InputError: as in `update`.
        """
        checked = checked_rgbd(frame)
        within = None if mask is None else checked_mask(mask, checked.depth.shape)
        with self._estimator() as estimator:
            return self._search(_Step(estimator.prepare(checked, within)))

    def _search(self, step: "_Step") -> TrackingResult:
        ids = [i for i in self._object_ids if i in step.models]
        every, lost = self.settings.search_every, list[Track]()
        # The most certain instance takes the pixels that it explains first.
        for track in sorted(self._tracks, key=lambda track: -track.score):
            if track.object_id in ids and not step.follow(track, self.settings):
                lost.append(track)
        counts = {}
        for object_id in ids:
            tracked = sum(track.object_id == object_id for track, _ in step.found)
            missing, since = self._max_instances - tracked, self._since_search.get(object_id)
            again = tracked == 0 or any(track.object_id == object_id for track in lost)
            due = every is not None and (since is None or since >= every)
            if missing > 0 and (again or due):
                counts[object_id] = missing
            since = 0 if object_id in counts else since or 0
            self._since_search[object_id] = since + 1
        rejections = step.search(counts, self.settings.min_score, lost, self._numbers)
        self._tracks = tuple(track for track, _ in step.found)
        answers = sorted((answer for _, answer in step.found), key=lambda answer: -answer.score)
        return TrackingResult(with_ranks(answers, step.models, step.context.frame), rejections)


@dataclass(frozen=True)
class Track:
    """One instance as it was last seen: its number, its pose, and the pose in the frame before.

    `before` is None unless the instance was tracked from that frame on.
    """

    number: int
    object_id: int
    score: float
    pose_cam_obj: Pose
    before: Pose | None = None

    def start_poses(self, centroid: Vector, prediction: bool) -> Poses:
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
        return np.stack([last, rigid(rotation, 2.0 * now - then - rotation @ centroid)])


class _Step:
    """One frame of a sequence, while its instances are found one after another."""

    def __init__(self, context: FrameContext) -> None:
        self.context, self.models = context, context.estimator.learnt.models
        self.found: list[tuple[Track, TrackedDetection]] = []
        self._begun = time.perf_counter()
        self._rest = Unexplained(context.observation, context.estimator.verifier, None)
        self._taken = 0  # of what was found: its pixels are left out of the rest

    def follow(self, track: Track, settings: TrackingSettings) -> bool:
        """Find an instance where it was; False if it is not there."""
        answer = follow(self.context, track, self._unexplained(), settings)
        if answer is None or answer.score < settings.min_score:
            return False
        self._add(replace(answer, seconds=time.perf_counter() - self._begun), track, tracked=True)
        return True

    def search(
        self, counts: dict[int, int], min_score: float, lost: Sequence[Track], numbers: "count[int]"
    ) -> list[Rejection]:
        """Find objects in the whole frame; why those without any instance are not found."""
        if not counts:
            return []
        begun, rest = self._begun, self._unexplained()
        trace = search_frame(
            self.context, counts, min_score=min_score, unexplained=rest, begun=begun
        )
        result = sort_answers(self.context, trace, min_score)
        for object_id in counts:
            name = self.models[object_id].name
            of_object = [answer for answer in result.detections if answer.object == name]
            places = [track for track in lost if track.object_id == object_id]
            for answer, known in _matched(of_object, places):
                last = known or Track(next(numbers), object_id, 0.0, answer.pose_cam_obj)
                self._add(answer, last, tracked=False)
        present = {answer.object for _, answer in self.found}
        return [rejection for rejection in result.rejections if rejection.object not in present]

    def _add(self, answer: Detection, last: Track, tracked: bool) -> None:
        """Take an answer up; of poses that are equal, the nearest to the last one."""
        symmetries = self.models[last.object_id].symmetries
        pose = nearest_symmetric_pose(last.pose_cam_obj, answer.pose_cam_obj, symmetries)
        answer = replace(answer, pose_cam_obj=pose, equivalent_poses=pose @ symmetries)
        before = last.pose_cam_obj if tracked else None
        track = replace(last, score=answer.score, pose_cam_obj=pose, before=before)
        numbered = TrackedDetection(**vars(answer), track=last.number, tracked=tracked)
        self.found.append((track, numbered))
        self._begun = time.perf_counter()

    def _unexplained(self) -> Observation | None:
        """The frame without what the instances explain that were found so far."""
        for track, _ in self.found[self._taken :]:
            self._rest.take(track.object_id, track.pose_cam_obj)
        self._taken = len(self.found)
        return self._rest.left


def follow(
    context: FrameContext, track: Track, unexplained: Observation | None, settings: TrackingSettings
) -> Detection | None:
    """The best answer about where the instance was; None if other instances explain all of it.

    Start poses are followed in order of their cost, until one has a good score. If none has, they
    are refined as hypotheses are, which finds poses that are farther away.
    """
    object_id, estimator = track.object_id, context.estimator
    model, verifier = estimator.learnt.models[object_id], estimator.verifier(object_id)
    starts = track.start_poses(model.centroid, settings.prediction)
    starts = starts[refinable(starts, model.centroid)]
    near = part_near(context, model, starts)
    if len(starts) > 1:
        starts = starts[np.argsort(verifier.costs(near.observation, starts), kind="stable")]
    answers = list[Detection]()
    for start in starts:
        pose = estimator.follow(near, object_id, start)
        if unexplained is not None:
            evidence = verifier.evidence(near.observation, pose[None])
            if not verifier.is_free(unexplained, pose[None], evidence)[0]:
                continue
        answers.append(describe_pose(near, object_id, pose))
        if answers[-1].score >= settings.min_score:
            return answers[-1]
    all_starts = Hypotheses(starts, np.ones(len(starts)))
    refined = estimator.refine(context, object_id, all_starts, 1, unexplained)
    answers += describe(context, object_id, refined)
    return max(answers, key=lambda answer: answer.score, default=None)


def part_near(context: FrameContext, model: ObjectModel, poses_cam_obj: Poses) -> FrameContext:
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
    estimator = context.estimator
    verification = estimator.settings.fine.refinement.verification
    matches = FrameMatches(estimator.matching, part)
    return FrameContext(estimator, part, context.windows, matches, verification)


def _matched(
    answers: Sequence[Detection], places: Sequence[Track]
) -> list[tuple[Detection, Track | None]]:
    """Each answer with the nearest lost instance, the nearest pair first; None is a new one."""
    shifts = [[a.pose_cam_obj[:3, 3] - b.pose_cam_obj[:3, 3] for b in places] for a in answers]
    apart = np.linalg.norm(np.reshape(shifts, (len(answers), len(places), 3)), axis=2)
    known: dict[int, Track] = {}
    for _ in range(min(apart.shape)):
        row, column = np.unravel_index(int(np.argmin(apart)), apart.shape)
        known[int(row)] = places[int(column)]
        apart[row], apart[:, column] = np.inf, np.inf
    return [(answer, known.get(row)) for row, answer in enumerate(answers)]
