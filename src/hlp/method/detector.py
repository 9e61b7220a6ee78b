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
from hlp.method import arguments
from hlp.method.arguments import RgbdFrame
from hlp.method.compute_threads import one_blas_thread
from hlp.method.find.detections import (
    Detection,
    SearchResult,
    TrackedDetection,
    sort_answers,
)
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.learn.backgrounds import GivenBackgrounds
from hlp.method.learn.learnt_folder import LearntFolder
from hlp.method.learn.unfinished_folder import restore_replaced
from hlp.method.settings import Device, FindSettings, MethodSettings, TrackingSettings
from hlp.method.track.tracker import Track, Tracker, follow
from hlp.records import Frame, ObjectModel
from hlp.refinement.score_model import MIN_SCORE

AnyPath = str | PathLike[str]
Rgb = UInt8[np.ndarray, "h w 3"]
Depth = Float[np.ndarray, "h w"]
Camera = Float[np.ndarray, "3 3"]

MOST_INSTANCES = 10
"""Instances of one object that are looked for in an image."""


class Detector:
    """Finds learnt objects in RGB-D images: arrays in, poses out.

    Only `learn`, `add` and `remove` write files. Several threads may use one detector; their calls
    are executed one after another. The same image gives the same poses, whichever images came
    before and whatever the number of `threads`.

    All methods raise InputError, which names the argument that is wrong.

    Examples:
        `Detector.learn` makes a folder once, which takes minutes. Afterwards:

        >>> detector = Detector.load("learnt")
        >>> for found in detector.detect(rgb, depth, camera_matrix, ["bear"]):
        ...     print(found)
        bear: score ... at (...) mm, ...% visible
    """

    def __init__(
        self, folder: AnyPath, threads: int | None = None, device: Device | None = None
    ) -> None:
        """Open a folder of learnt objects; see `load`."""
        # Files are read later, from any working directory.
        self.folder = arguments.checked_path(folder, "folder").resolve()
        restore_replaced(self.folder)
        self._threads, self._device = threads, device
        self._lock = threading.Lock()
        self._blas = ThreadpoolController()
        self._open()

    def __reduce__(self) -> tuple[type["Detector"], tuple[object, ...]]:
        """Pickled as the name of its folder: another process opens the folder itself."""
        return Detector, (self.folder, self._threads, self._device)

    def __repr__(self) -> str:
        settings, objects = self._settings, list(self.objects)
        chosen = ", ".join(
            f"{group}={getattr(settings, group).name}"
            for group in ("encoder", "codebook", "refinement")
        )
        return f"Detector({str(self.folder)!r}, {objects=}, {chosen}, threads={self.threads})"

    def _open(self) -> None:
        learnt = LearntFolder(self.folder, self._threads, self._device)
        self._ids, self._settings = dict(learnt.record.objects), learnt.settings
        find = FindSettings.of(learnt.settings)
        self._estimator = PoseEstimator(learnt, find, tuple(self._ids.values()))

    @classmethod
    def learn(
        cls,
        meshes: Mapping[str, AnyPath],
        folder: AnyPath,
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

        Examples:
            >>> meshes = {"bear": "bear.ply", "can": "can.ply"}
            >>> detector = Detector.learn(meshes, "learnt", mesh_scale=0.001)  # doctest: +SKIP
        """
        from hlp.method.learn.learning import learn  # with torch, which takes seconds

        settings = MethodSettings() if settings is None else settings
        if not isinstance(settings, MethodSettings):
            raise InputError(f"settings is {settings!r}: it must be MethodSettings")
        target = arguments.checked_path(folder, "folder")
        backgrounds = GivenBackgrounds(arguments.checked_backgrounds(background_frames))
        learn(_build_models(meshes, mesh_scale, 1), target, settings, backgrounds)
        return cls(folder)

    @classmethod
    def load(
        cls, folder: AnyPath, *, threads: int | None = None, device: Device | None = None
    ) -> "Detector":
        """Open a folder that `learn` wrote, here or on another machine.

        Networks and codebooks are read when first needed, or by `warm_up`.

        Args:
            folder: the folder.
            threads: number of threads of kernels and networks; None: as when learning.
            device: runs the networks, "cpu" or "cuda"; None: as when learning.

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
        meshes: Mapping[str, AnyPath],
        *,
        mesh_scale: float | None = None,
        background_frames: Iterable[Frame] = (),
    ) -> None:
        """Learn more objects, given as in `learn`, into the folder.

        The encoder stays as it is and the classifier is trained further.

        Examples:
            >>> detector.add({"cat": "cat.ply"}, mesh_scale=0.001)  # doctest: +SKIP
        """
        from hlp.method.learn.learning import add

        with self._lock:
            first_id = LearntFolder(self.folder).record.next_id
            backgrounds = GivenBackgrounds(arguments.checked_backgrounds(background_frames))
            add(self.folder, _build_models(meshes, mesh_scale, first_id), backgrounds)
            self._open()

    def remove(self, name: str) -> None:
        """Take an object out of the folder, unless it is the only one.

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
        rgb: Rgb,
        depth: Depth,
        camera_matrix: Camera,
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
        depth: Depth,
        camera_matrix: Camera,
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        min_score: float = MIN_SCORE,
        mask: Bool[np.ndarray, "h w"] | None = None,
    ) -> SearchResult:
        """Find objects as `detect` does, and say for each why it has no other detection.

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
            trace = search_frame(estimator, context, counts, min_score=min_score, begun=begun)
            return sort_answers(estimator, context, trace, min_score)

    def refine(
        self,
        rgb: Rgb,
        depth: Depth,
        camera_matrix: Camera,
        object: str,
        pose_cam_obj: Float[np.ndarray, "4 4"],
    ) -> Detection | None:
        """The best pose of an object about a given one, by the refiner alone (stage 3).

        For a pose (4, 4), which maps the object's coordinates to the camera's (metres), that is
        roughly known: from another detector, or from a moment before. The image is given as in
        `detect`. None if the object is not in front of the camera.

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
            found = follow(estimator, estimator.prepare(frame), track, None, TrackingSettings())
            return found and replace(found, seconds=time.perf_counter() - begun)

    def tracker(
        self,
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        settings: TrackingSettings | None = None,
    ) -> Tracker:
        """What follows objects, given as in `detect`, through one sequence of frames.

        Examples:
            >>> tracker = detector.tracker(["bear"], max_instances=1)
            >>> [found.tracked for found in tracker.update(image)]
            [False]
        """
        settings = TrackingSettings() if settings is None else settings
        if not isinstance(settings, TrackingSettings):
            raise InputError(f"settings is {settings!r}: it must be TrackingSettings")
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
        """The objects in each frame of a sequence; the same as `Tracker.update` frame by frame.

        An object is searched where it was last seen, which takes a tenth of the time of detection,
        and detected where that fails. Frames have `rgb`, `depth` and `camera_matrix` as in
        `detect`, as `hlp.CameraImage` has. What is found in a frame, the most certain first, comes
        as soon as the frame is there.

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
        return arguments.checked_names(objects, self.objects, self.folder)


def _build_models(
    meshes: Mapping[str, AnyPath], mesh_scale: float | None, first_id: int
) -> dict[int, ObjectModel]:
    from hlp.method.learn.mesh_models import MeshChoices, build_models  # with trimesh

    choices = MeshChoices(mesh_scale=mesh_scale)
    return build_models(arguments.checked_meshes(meshes), choices, first_id)
