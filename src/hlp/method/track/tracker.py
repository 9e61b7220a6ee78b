"""Objects through a sequence of frames: followed from pose to pose, detected where that fails."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from itertools import count
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float, UInt8

from hlp.errors import InputError
from hlp.method.arguments import checked_frame, checked_mask
from hlp.method.find.detections import Detection, Rejection, describe_all, sort_answers
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.track.tracking import (
    Track,
    TrackedDetection,
    TrackingResult,
    TrackingSettings,
    follow,
    numbered,
)
from hlp.refinement.verification import Observation


class RgbdFrame(Protocol):
    """An RGB-D image with its camera, as `Detector.detect` takes them: `hlp.CameraImage` is one."""

    @property
    def rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Colour, red first."""
        ...

    @property
    def depth(self) -> Float[np.ndarray, "h w"]:
        """Depth (m) along the optical axis, registered to the colour; 0 or NaN where missing."""
        ...

    @property
    def camera_matrix(self) -> Float[np.ndarray, "3 3"]:
        """Intrinsics (px), with pixel centres at integers."""
        ...


class Tracker:
    """Follows objects from frame to frame. Made by `Detector.tracker`.

    An instance that was found in the last frame is looked for where it was, by the refiner alone.
    If its score is then too low, its object is detected again in the same frame. Frames are taken
    to be equally far apart in time. A tracker belongs to one sequence; several trackers may use one
    detector.

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
        self._numbers = count()
        self._tracks: tuple[Track, ...] = ()
        self._since_search: dict[int, int] = {}

    def reset(self) -> None:
        """Forget all poses: the next frame is searched as the first one was."""
        self._tracks, self._since_search, self._numbers = (), {}, count()

    def update(
        self, frame: RgbdFrame, mask: Bool[np.ndarray, "h w"] | None = None
    ) -> list[TrackedDetection]:
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

    def search(
        self, frame: RgbdFrame, mask: Bool[np.ndarray, "h w"] | None = None
    ) -> TrackingResult:
        """Find objects as `update` does, and say of each that is not found, why.

        Args:
            frame: as in `update`.
            mask: as in `update`.

        Returns:
            Detections, and the rejected answers with the reasons.

        Raises:
            InputError: as in `update`.
        """
        for name in ("rgb", "depth", "camera_matrix"):
            if not hasattr(frame, name):
                raise InputError(f"a frame must have rgb, depth and camera_matrix: {name} is not")
        checked = checked_frame(frame.rgb, frame.depth, frame.camera_matrix)
        within = None if mask is None else checked_mask(mask, checked.depth.shape)
        with self._estimator() as estimator:
            return self._search(_Step(estimator, estimator.prepare(checked, within)))

    def _search(self, step: "_Step") -> TrackingResult:
        ids = [each for each in self._object_ids if each in step.estimator.learnt.models]
        lost = list[Track]()
        # The most certain instance takes the pixels that it explains first.
        for track in sorted(self._tracks, key=lambda each: -each.score):
            if track.object_id in ids and not step.follow(track, self.settings):
                lost.append(track)
        wanted = self._wanted(step, ids, {each.object_id for each in lost})
        rejections = step.search(wanted, self.settings.min_score, lost, self._numbers)
        for object_id in ids:
            since = self._since_search.get(object_id, 0) + 1
            self._since_search[object_id] = 1 if object_id in wanted else since
        self._tracks = tuple(step.tracks)
        found = sorted(step.found, key=lambda each: -each.score)
        return TrackingResult(found, rejections)

    def _wanted(self, step: "_Step", ids: Sequence[int], lost: set[int]) -> dict[int, int]:
        """How many instances of which objects are to be searched in the whole frame."""
        wanted, every = {}, self.settings.search_every
        for object_id in ids:
            tracked = sum(each.object_id == object_id for each in step.tracks)
            due = every > 0 and self._since_search.get(object_id, every) >= every
            missing = self._max_instances - tracked
            if missing > 0 and (tracked == 0 or object_id in lost or due):
                wanted[object_id] = missing
        return wanted


class _Step:
    """One frame of a sequence, while its instances are found one after another."""

    def __init__(self, estimator: PoseEstimator, context: FrameContext) -> None:
        self.estimator, self.context = estimator, context
        self.tracks: list[Track] = []
        self.found: list[TrackedDetection] = []
        self._begun = time.perf_counter()
        self._left: Observation | None = None
        self._pending: list[Track] = []  # what they explain is still in the observation

    def follow(self, track: Track, settings: TrackingSettings) -> bool:
        """Find an instance where it was; False if it is not there."""
        left = self._unexplained()
        answer = follow(self.estimator, self.context, track, left, settings)
        if answer is None or answer.score < settings.min_score:
            return False
        answer = replace(answer, seconds=time.perf_counter() - self._begun)
        seen = replace(track, score=answer.score, pose_cam_obj=answer.pose_cam_obj)
        self._add(answer, replace(seen, before=track.pose_cam_obj), tracked=True)
        return True

    def search(
        self, wanted: dict[int, int], min_score: float, lost: Sequence[Track], numbers: "count[int]"
    ) -> list[Rejection]:
        """Find objects in the whole frame; why those without any instance are not found."""
        if not wanted:
            return []
        estimator = self.estimator
        trace = search_frame(
            estimator,
            self.context,
            wanted,
            min_score=min_score,
            unexplained=self._unexplained(),
            begun=self._begun,
        )
        answers = describe_all(estimator, self.context, trace)
        names = {i: estimator.learnt.models[i].name for i in wanted}
        missing = [names[i] for i, found in trace.items() if found.refined is None]
        result = sort_answers(answers, missing, min_score)
        for object_id, name in names.items():
            of_object = [each for each in result.detections if each.object == name]
            places = [each for each in lost if each.object_id == object_id]
            for answer, known in _matched(of_object, places):
                number = next(numbers) if known is None else known.number
                new = Track(number, object_id, answer.score, answer.pose_cam_obj)
                self._add(answer, new, tracked=False)
        present = {each.object for each in self.found}
        return [each for each in result.rejections if each.object not in present]

    def _add(self, answer: Detection, track: Track, tracked: bool) -> None:
        self.tracks.append(track)
        self.found.append(numbered(answer, track.number, tracked))
        self._pending.append(track)
        self._begun = time.perf_counter()

    def _unexplained(self) -> Observation | None:
        """The frame without what the instances explain that were found so far."""
        for each in self._pending:
            before = self.context.observation if self._left is None else self._left
            verifier = self.estimator.verifier(each.object_id)
            self._left = verifier.without_explained(before, each.pose_cam_obj)
        self._pending.clear()
        return self._left


def _matched(
    answers: Sequence[Detection], places: Sequence[Track]
) -> list[tuple[Detection, Track | None]]:
    """Each answer with the nearest lost instance, the nearest pair first; None is a new one."""
    if not answers or not places:
        return [(each, None) for each in answers]
    shifts = np.array(
        [[a.pose_cam_obj[:3, 3] - b.pose_cam_obj[:3, 3] for b in places] for a in answers]
    )
    apart = np.linalg.norm(shifts, axis=2)
    known: dict[int, Track] = {}
    for _ in range(min(apart.shape)):
        row, column = np.unravel_index(int(np.argmin(apart)), apart.shape)
        known[int(row)] = places[int(column)]
        apart[row], apart[:, column] = np.inf, np.inf
    return [(each, known.get(row)) for row, each in enumerate(answers)]
