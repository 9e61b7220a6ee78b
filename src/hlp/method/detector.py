"""The method as one class: learn objects from CAD models, find them in RGB-D images."""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from hlp.arrays import CameraMatrix, Image, Mask, Pose, Rgb
from hlp.errors import InputError
from hlp.method import arguments
from hlp.method.arguments import RgbdFrame
from hlp.method.find.detections import Detection, SearchResult, TrackedDetection, sort_answers
from hlp.method.find.search import MOST_INSTANCES, search_frame
from hlp.method.opened_folder import OpenedFolder
from hlp.method.settings import TrackingSettings
from hlp.method.tracker import Track, Tracker, follow
from hlp.refinement.score_model import MIN_SCORE


class Detector(OpenedFolder):
    """Finds learnt objects in RGB-D images: arrays in, poses out.

    Only `learn`, `add` and `remove` write files. Several threads may use one detector; their calls
    are executed one after another. The same image gives the same poses, whichever images came
    before and whatever the number of `threads`.

    All methods raise `hlp.errors.InputError` for a wrong argument, which the message names.

    Examples:
        `Detector.learn` makes a folder once, which takes minutes. Afterwards:

        >>> detector = Detector.load("learnt")
        >>> for found in detector.detect(rgb, depth, camera_matrix, ["bear"]):
        ...     print(found)
        bear: score ... at (...) mm, ...% visible
    """

    def detect(
        self,
        rgb: Rgb,
        depth: Image,
        camera_matrix: CameraMatrix,
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        min_score: float = MIN_SCORE,
        mask: Mask | None = None,
    ) -> list[Detection]:
        """Find objects in one RGB-D image.

        Args:
            rgb: (h, w, 3) uint8, red first.
            depth: (h, w) floating point, metres along the optical axis, registered to `rgb`; 0 or
                NaN where missing.
            camera_matrix: (3, 3) floating point, pixels, with pixel centres at integers.
            objects: their names; None: all learnt ones.
            max_instances: how many instances of one object are looked for.
            min_score: the least probability that a pose is right.
            mask: (h, w) bool; only what it covers votes for poses.

        Returns:
            All instances of the objects, the most certain first.

        Raises:
            InputError: an argument has another shape, type or unit, or an object is not learnt.
            DataError: a file of the folder was damaged after it was opened.

        Examples:
            >>> (found,) = detector.detect(rgb, depth, camera_matrix, ["bear"], max_instances=1)
            >>> found.object, found.pose_cam_obj.shape
            ('bear', (4, 4))
        """
        found = self.search(rgb, depth, camera_matrix, objects, max_instances, min_score, mask)
        return found.detections

    def search(
        self,
        rgb: Rgb,
        depth: Image,
        camera_matrix: CameraMatrix,
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        min_score: float = MIN_SCORE,
        mask: Mask | None = None,
    ) -> SearchResult:
        """Find objects as `detect` does, and say for each why it has no other detection.

        Args:
            rgb: this and all others as in `detect`.
            depth: (h, w) floating point, metres.
            camera_matrix: (3, 3) floating point, pixels.
            objects: names, or None.
            max_instances: of one object.
            min_score: what scores less is rejected, not detected.
            mask: (h, w) bool.

        Returns:
            Detections, and the rejected answers with the reasons.

        Raises:
            InputError: as in `detect`.

        Examples:
            >>> result = detector.search(rgb, 0 * depth, camera_matrix, ["bear"])
            >>> result.detections, result.rejections[0].reason
            ([], 'nothing looks like the object where the image has depth and ...')
        """
        frame = arguments.checked_frame(rgb, depth, camera_matrix)
        names = self._checked_names(objects)
        arguments.check_limits(max_instances, min_score)
        within = None if mask is None else arguments.checked_mask(mask, frame.depth.shape)
        with self._alone() as estimator:
            begun = time.perf_counter()
            context = estimator.prepare(frame, within)
            counts = {self._ids[name]: max_instances for name in names}
            trace = search_frame(context, counts, min_score=min_score, begun=begun)
            return sort_answers(context, trace, min_score)

    def refine(
        self, rgb: Rgb, depth: Image, camera_matrix: CameraMatrix, object: str, pose_cam_obj: Pose
    ) -> Detection | None:
        """Improve a pose that is roughly known, by the refiner alone (stage 3).

        It may come from another detector, or from the image before.

        Args:
            rgb: (h, w, 3) uint8, red first.
            depth: (h, w) floating point, metres.
            camera_matrix: (3, 3) floating point, pixels.
            object: its name.
            pose_cam_obj: (4, 4), the rough pose: object to camera coordinates, metres.

        Returns:
            The pose found near the given one, with its score; None if the object would not be in
            front of the camera.

        Raises:
            InputError: as in `detect`, or the pose is not a rigid motion.

        Examples:
            >>> (found,) = detector.detect(rgb, depth, camera_matrix, ["bear"], max_instances=1)
            >>> rough = found.pose_cam_obj.copy()
            >>> rough[:3, 3] += 0.005
            >>> detector.refine(rgb, depth, camera_matrix, "bear", rough).object
            'bear'
        """
        frame = arguments.checked_frame(rgb, depth, camera_matrix)
        (name,) = self._checked_names([object])
        track = Track(0, self._ids[name], 0.0, arguments.checked_pose(pose_cam_obj))
        with self._alone() as estimator:
            begun = time.perf_counter()
            found = follow(estimator.prepare(frame), track, None, TrackingSettings())
            return found and replace(found, seconds=time.perf_counter() - begun)

    def tracker(
        self,
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        settings: TrackingSettings | None = None,
    ) -> Tracker:
        """Make a tracker, which follows objects through one sequence of frames.

        Args:
            objects: their names; None: all learnt ones.
            max_instances: how many instances of one object are followed.
            settings: None: the defaults.

        Returns:
            A tracker, to be given one frame after another.

        Examples:
            >>> tracker = detector.tracker(["bear"], max_instances=1)
            >>> [found.tracked for found in tracker.update(image)]
            [False]
        """
        settings = arguments.checked_settings(settings, TrackingSettings)
        arguments.check_limits(max_instances, settings.min_score)
        ids = [self._ids[name] for name in self._checked_names(objects)]
        return Tracker(self._alone, ids, max_instances, settings)

    def track(
        self,
        frames: Iterable[RgbdFrame],
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        settings: TrackingSettings | None = None,
    ) -> Iterator[list[TrackedDetection]]:
        """Follow objects through a sequence of frames, as `Tracker.update` does frame by frame.

        An object is searched where it was last seen, in a small part of the time of detection, and
        detected where that fails.

        Args:
            frames: have `rgb`, `depth` and `camera_matrix` as in `detect`, as `hlp.CameraImage`.
            objects: their names; None: all learnt ones.
            max_instances: how many instances of one object are followed.
            settings: None: the defaults.

        Returns:
            For each frame, as soon as it is there, what is found in it, the most certain first.

        Raises:
            InputError: as in `detect`, when the frame that is wrong is reached.

        Examples:
            >>> for found in detector.track([image, image], ["bear"], max_instances=1):
            ...     print([(one.object, one.track, one.tracked) for one in found])
            [('bear', 0, False)]
            [('bear', 0, True)]
        """
        tracker = self.tracker(objects, max_instances, settings)
        if not isinstance(frames, Iterable):
            raise InputError(f"frames is {frames!r}: give frames one after another")
        return (tracker.update(frame) for frame in frames)
