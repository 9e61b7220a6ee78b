"""The method as one class: learn objects from CAD models, find them in RGB-D images."""

import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike

import numpy as np
from jaxtyping import Bool, Float, UInt8
from threadpoolctl import ThreadpoolController

from hlp.errors import InputError
from hlp.method.arguments import (
    check_limits,
    checked_backgrounds,
    checked_frame,
    checked_mask,
    checked_meshes,
    checked_names,
    checked_path,
    checked_pose,
)
from hlp.method.compute_threads import one_blas_thread
from hlp.method.find.detections import Detection, SearchResult, describe_all, sort_answers
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.learn.learnt_folder import LearntFolder
from hlp.method.learn.unfinished_folder import bring_back
from hlp.method.settings import Device, MethodSettings
from hlp.method.stage_settings import FindSettings
from hlp.method.track.tracker import RgbdFrame, Tracker
from hlp.method.track.tracking import Track, TrackedDetection, TrackingSettings, follow
from hlp.records import Frame, ObjectModel
from hlp.refinement.score_model import MIN_SCORE

MOST_INSTANCES = 10
"""Instances of one object that are looked for in an image."""


class Detector:
    """Finds learnt objects in RGB-D images: arrays in, poses out.

    Only `learn`, `add` and `remove` write files. Several threads may use one detector; their calls
    are executed one after another. The same image gives the same poses, whichever images came
    before and whatever the number of `threads`.

    Examples:
        `Detector.learn` makes a folder once, which takes minutes. Afterwards:

        >>> detector = Detector.load("learnt")
        >>> for found in detector.detect(rgb, depth, camera_matrix, ["bear"]):
        ...     print(found)
        bear: score ... at (...) mm, ...% visible
    """

    def __init__(
        self,
        folder: str | PathLike[str],
        threads: int | None = None,
        device: Device | None = None,
    ) -> None:
        """Open a folder of learnt objects; see `load`."""
        # Files are read later, from any working directory.
        self.folder = checked_path(folder, "folder").resolve()
        bring_back(self.folder)
        self._threads, self._device = threads, device
        self._lock = threading.Lock()
        self._blas = ThreadpoolController()
        self._open()

    def __reduce__(self) -> tuple[type["Detector"], tuple[object, ...]]:
        """Pickled as the name of its folder: another process opens the folder itself."""
        return Detector, (self.folder, self._threads, self._device)

    def __repr__(self) -> str:
        settings = self._settings
        return (
            f"Detector({str(self.folder)!r}, objects={list(self.objects)}, "
            f"encoder={settings.encoder.name}, codebook={settings.codebook.name}, "
            f"refinement={settings.refinement.name}, threads={self.threads})"
        )

    def _open(self) -> None:
        learnt = LearntFolder(self.folder, self._threads, self._device)
        self._ids = dict(learnt.record.objects)
        self._estimator = PoseEstimator(
            learnt, FindSettings.of(learnt.settings), tuple(self._ids.values())
        )
        self._settings = learnt.settings

    @classmethod
    def learn(
        cls,
        meshes: Mapping[str, str | PathLike[str]],
        folder: str | PathLike[str],
        *,
        settings: MethodSettings | None = None,
        mesh_scale: float | None = None,
        background_frames: Iterable[Frame] = (),
    ) -> "Detector":
        """Learn objects from their CAD models into a new folder. This takes minutes on two cores.

        Repeat an interrupted call to continue it. Progress is shown on a terminal. Sets the threads
        of torch, OpenCV and BLAS in this process.

        Args:
            meshes: names and files (PLY, OBJ, STL, …).
            folder: must not exist yet.
            settings: None: the defaults.
            mesh_scale: metres per unit of the files (0.001: millimetres); None: guessed from the
                size, and logged.
            background_frames: RGB-D frames of places without the objects, which are better
                backgrounds than the procedural ones.

        Returns:
            The detector of the new folder.

        Raises:
            InputError: a name or mesh is wrong, or the folder already exists.

        Examples:
            >>> meshes = {"bear": "bear.ply", "can": "can.ply"}
            >>> detector = Detector.learn(meshes, "learnt", mesh_scale=0.001)  # doctest: +SKIP
        """
        from hlp.method.learn.backgrounds import GivenBackgrounds
        from hlp.method.learn.learning import learn
        from hlp.method.learn.mesh_models import MeshChoices, build_models

        choices = MeshChoices(mesh_scale=mesh_scale)
        settings = MethodSettings() if settings is None else settings
        if not isinstance(settings, MethodSettings):
            raise InputError(f"settings is {settings!r}: it must be MethodSettings")
        target = checked_path(folder, "folder")
        backgrounds = GivenBackgrounds(checked_backgrounds(background_frames))
        models = build_models(checked_meshes(meshes), choices, 1)
        learn(models, target, settings, backgrounds)
        return cls(folder)

    @classmethod
    def load(
        cls,
        folder: str | PathLike[str],
        *,
        threads: int | None = None,
        device: Device | None = None,
    ) -> "Detector":
        """Open a folder that `learn` wrote, here or on another machine.

        Networks and codebooks are read when first needed, or by `warm_up`.

        Args:
            folder: the folder.
            threads: number of threads of kernels and networks; None: as when learning.
            device: runs the networks, "cpu" or "cuda"; None: as when learning.

        Returns:
            A detector of the objects in the folder.

        Raises:
            MissingFileError: the folder holds no learnt objects.
            DataError: they are damaged or of another version.

        Examples:
            >>> Detector.load("learnt", threads=1).objects
            ('bear', 'can')
        """
        return cls(folder, threads, device)

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the learnt objects."""
        return tuple(self._ids)

    @property
    def threads(self) -> int:
        """Threads of kernels and networks."""
        return self._estimator.settings.machine.threads

    @property
    def models(self) -> dict[str, ObjectModel]:
        """The learnt objects' models by name: mesh, diameter, symmetries, id.

        Examples:
            >>> detector.models["bear"].symmetries.shape  # the identity alone
            (1, 4, 4)
        """
        learnt = self._estimator.learnt.models
        return {name: learnt[object_id] for name, object_id in self._ids.items()}

    def add(
        self,
        meshes: Mapping[str, str | PathLike[str]],
        *,
        mesh_scale: float | None = None,
        background_frames: Iterable[Frame] = (),
    ) -> None:
        """Learn more objects into the folder.

        The encoder stays as it is and the classifier is trained further.

        Args:
            meshes: as in `learn`.
            mesh_scale: as in `learn`.
            background_frames: as in `learn`.

        Raises:
            InputError: a name or mesh is wrong, or a name is already used.

        Examples:
            >>> detector.add({"cat": "cat.ply"}, mesh_scale=0.001)  # doctest: +SKIP
        """
        from hlp.method.learn.backgrounds import GivenBackgrounds
        from hlp.method.learn.learning import add
        from hlp.method.learn.mesh_models import MeshChoices, build_models

        choices = MeshChoices(mesh_scale=mesh_scale)
        with self._lock:
            first_id = LearntFolder(self.folder).record.next_id
            backgrounds = GivenBackgrounds(checked_backgrounds(background_frames))
            models = build_models(checked_meshes(meshes), choices, first_id)
            add(self.folder, models, backgrounds)
            self._open()

    def remove(self, name: str) -> None:
        """Take an object out of the folder.

        Args:
            name: a learnt object.

        Raises:
            InputError: it is not learnt, or there is no other object.

        Examples:
            >>> detector.remove("can")
            >>> detector.objects
            ('bear',)
        """
        from hlp.method.learn.learning import remove

        with self._lock:
            remove(self.folder, name)
            self._open()

    def warm_up(self) -> None:
        """Load all networks and codebooks now instead of at the first `detect`."""
        with self._lock:
            self._estimator.load(tuple(self._ids.values()))

    def detect(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        min_score: float = MIN_SCORE,
        mask: Bool[np.ndarray, "h w"] | None = None,
    ) -> list[Detection]:
        """Find objects in one RGB-D image.

        Args:
            rgb: (h, w, 3) uint8, red first.
            depth: (h, w) floating point, metres along the optical axis, registered to `rgb`; 0 or
                NaN where missing.
            camera_matrix: (3, 3), pixels, with pixel centres at integers.
            objects: their names; None: all learnt ones.
            max_instances: how many instances of one object are looked for.
            min_score: the least probability that a pose is right.
            mask: (h, w) bool; only what it covers votes for poses.

        Returns:
            All instances of the objects, the most certain first.

        Raises:
            InputError: an argument, which it names, is wrong.

        Examples:
            >>> (found,) = detector.detect(rgb, depth, camera_matrix, ["bear"], max_instances=1)
            >>> found.object, found.pose_cam_obj.shape
            ('bear', (4, 4))
        """
        found = self.search(rgb, depth, camera_matrix, objects, max_instances, min_score, mask)
        return found.detections

    def search(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        min_score: float = MIN_SCORE,
        mask: Bool[np.ndarray, "h w"] | None = None,
    ) -> SearchResult:
        """Find objects as `detect` does, and say for each why it has no other detection.

        Args:
            rgb: as in `detect`, like all arguments.
            depth: see above.
            camera_matrix: see above.
            objects: see above.
            max_instances: see above.
            min_score: see above.
            mask: see above.

        Returns:
            Detections, and the rejected answers with the reasons.

        Raises:
            InputError: an argument, which it names, is wrong.

        Examples:
            >>> result = detector.search(rgb, 0 * depth, camera_matrix, ["bear"])
            >>> result.detections, result.rejections[0].reason
            ([], 'nothing looks like the object where the image has depth and ...')
        """
        frame = checked_frame(rgb, depth, camera_matrix)
        names = self._checked_names(objects)
        check_limits(max_instances, min_score)
        within = None if mask is None else checked_mask(mask, frame.depth.shape)
        with self._alone() as estimator:
            begun = time.perf_counter()
            context = estimator.prepare(frame, within)
            counts = {self._ids[name]: max_instances for name in names}
            trace = search_frame(estimator, context, counts, min_score=min_score, begun=begun)
            answers = describe_all(estimator, context, trace)
        missing = [name for name in names if trace[self._ids[name]].refined is None]
        return sort_answers(answers, missing, min_score)

    def refine(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        object: str,
        pose_cam_obj: Float[np.ndarray, "4 4"],
    ) -> Detection | None:
        """The best pose of an object about a given one, by the refiner alone (stage 3).

        For a pose that is roughly known: from another detector, or from a moment before.

        Args:
            rgb: as in `detect`.
            depth: as in `detect`.
            camera_matrix: as in `detect`.
            object: name of a learnt object.
            pose_cam_obj: (4, 4), maps its coordinates to the camera's (metres).

        Returns:
            The refined pose, with its score; None if it is not in front of the camera.

        Raises:
            InputError: an argument, which it names, is wrong.

        Examples:
            >>> (found,) = detector.detect(rgb, depth, camera_matrix, ["bear"], max_instances=1)
            >>> rough = found.pose_cam_obj.copy()
            >>> rough[:3, 3] += 0.005
            >>> detector.refine(rgb, depth, camera_matrix, "bear", rough).object
            'bear'
        """
        frame = checked_frame(rgb, depth, camera_matrix)
        (name,) = self._checked_names([object])
        track = Track(0, self._ids[name], 0.0, checked_pose(pose_cam_obj))
        with self._alone() as estimator:
            begun = time.perf_counter()
            found = follow(estimator, estimator.prepare(frame), track, None, TrackingSettings())
            return found and replace(found, seconds=time.perf_counter() - begun)

    def tracker(
        self,
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        settings: TrackingSettings | None = None,
    ) -> Tracker:
        """What follows objects through one sequence of frames.

        Args:
            objects: their names; None: all learnt ones.
            max_instances: how many instances of one object are looked for.
            settings: None: the defaults.

        Returns:
            A tracker that has seen no frame yet.

        Raises:
            InputError: an argument, which it names, is wrong.

        Examples:
            >>> tracker = detector.tracker(["bear"], max_instances=1)
            >>> [found.tracked for found in tracker.update(image)]
            [False]
        """
        settings = TrackingSettings() if settings is None else settings
        if not isinstance(settings, TrackingSettings):
            raise InputError(f"settings is {settings!r}: it must be TrackingSettings")
        check_limits(max_instances, settings.min_score)
        ids = [self._ids[name] for name in self._checked_names(objects)]
        return Tracker(self._alone, ids, max_instances, settings)

    def track(
        self,
        frames: Iterable[RgbdFrame],
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        settings: TrackingSettings | None = None,
    ) -> Iterator[list[TrackedDetection]]:
        """The objects in each frame of a sequence; the same as `Tracker.update` frame by frame.

        An object is searched where it was last seen, which takes a tenth of the time of detection,
        and detected where that fails.

        Args:
            frames: have `rgb`, `depth` and `camera_matrix` as in `detect`, e.g. `hlp.CameraImage`.
            objects: their names; None: all learnt ones.
            max_instances: how many instances of one object are looked for.
            settings: None: the defaults.

        Returns:
            What is found in each frame, the most certain first, as soon as the frame is there.

        Raises:
            InputError: an argument or, when it is reached, a frame is wrong.

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

    @contextmanager
    def _alone(self) -> Iterator[PoseEstimator]:
        """The estimator for one thread at a time."""
        with self._lock, one_blas_thread(self._blas):
            yield self._estimator

    def _checked_names(self, objects: Sequence[str] | None) -> Sequence[str]:
        if objects is None:
            return self.objects
        return checked_names(objects, self.objects, self.folder)
