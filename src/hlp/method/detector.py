"""The method as one class: learn objects from CAD models, find them in RGB-D images."""

import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from threadpoolctl import ThreadpoolController

from hlp.errors import InputError
from hlp.method.compute_threads import one_blas_thread
from hlp.method.conflicts import Found, resolve_conflicts
from hlp.method.detections import Detection, SearchResult, describe, sort_answers
from hlp.method.instance_search import find_instances
from hlp.method.learnt_folder import LearntFolder
from hlp.method.pose_estimator import FrameContext, PoseEstimator
from hlp.method.settings import Device, MethodSettings
from hlp.records import Frame
from hlp.refinement.score_model import MIN_SCORE

MOST_INSTANCES = 10
"""Instances of one object that are looked for in an image."""
_FARTHEST = 20.0  # m: a larger median depth means another unit


class Detector:
    """Finds learnt objects in RGB-D images: arrays in, poses out.

        detector = Detector.learn({"bracket": "bracket.ply"}, "learnt/")   # minutes, once
        detector = Detector.load("learnt/")                                # afterwards
        for found in detector.detect(rgb, depth, camera_matrix):
            print(found.object, found.score, found.pose_cam_obj)

    Only `learn`, `add` and `remove` write files. Several threads may use one detector; their calls
    are executed one after another. The same image gives the same poses, whichever images came
    before and whatever the number of `threads`.
    """

    def __init__(
        self,
        folder: str | PathLike[str],
        threads: int | None = None,
        device: Device | None = None,
    ) -> None:
        """Open a folder of learnt objects; see `load`."""
        self.folder = Path(folder).resolve()  # files are read later, from any working directory
        self._threads, self._device = threads, device
        self._lock = threading.Lock()
        self._blas = ThreadpoolController()
        self._open()

    def _open(self) -> None:
        learnt = LearntFolder(self.folder, self._threads, self._device)
        self._ids = dict(learnt.record.objects)
        self._estimator = PoseEstimator(learnt, learnt.settings, tuple(self._ids.values()))

    @classmethod
    def learn(
        cls,
        meshes: Mapping[str, str | PathLike[str]],
        folder: str | PathLike[str],
        *,
        settings: MethodSettings | None = None,
        mesh_scale: float = 0.001,
        background_frames: Iterable[Frame] = (),
    ) -> "Detector":
        """Learn objects from their CAD models into a new folder. This takes minutes on two cores.

        `meshes` maps names to files (PLY, OBJ, STL, …); `mesh_scale` is metres per unit of the
        files (0.001: millimetres). RGB-D frames of places without the objects are better
        backgrounds than the procedural ones. Repeat an interrupted call to continue it. Progress
        is shown on a terminal. Sets the threads of torch, OpenCV and BLAS in this process.

        Raises InputError for a bad name or mesh, and for a folder that already exists.
        """
        from hlp.method.backgrounds import GivenBackgrounds
        from hlp.method.learning import build_models, learn

        models = build_models({n: Path(p) for n, p in meshes.items()}, mesh_scale, 1)
        backgrounds = GivenBackgrounds(tuple(background_frames))
        learn(models, Path(folder), MethodSettings() if settings is None else settings, backgrounds)
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

        Networks and codebooks are read when first needed, or by `warm_up`. `threads` is the number
        of threads of kernels and networks, `device` runs the networks (None: as when learning).
        Raises MissingFileError if the
        folder holds no learnt objects, DataError if they are damaged or of another version.
        """
        return cls(folder, threads, device)

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the learnt objects."""
        return tuple(self._ids)

    def add(
        self,
        meshes: Mapping[str, str | PathLike[str]],
        *,
        mesh_scale: float = 0.001,
        background_frames: Iterable[Frame] = (),
    ) -> None:
        """Learn more objects into the folder.

        The encoder stays as it is and the classifier is trained further. Arguments and errors are
        those of `learn`; also InputError for a name that is already used.
        """
        from hlp.method.backgrounds import GivenBackgrounds
        from hlp.method.learning import add, build_models

        with self._lock:
            first_id = LearntFolder(self.folder).record.next_id
            models = build_models({n: Path(p) for n, p in meshes.items()}, mesh_scale, first_id)
            add(self.folder, models, GivenBackgrounds(tuple(background_frames)))
            self._open()

    def remove(self, name: str) -> None:
        """Take an object out of the folder. Raises InputError for an unknown or the last one."""
        from hlp.method.learning import remove

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
    ) -> list[Detection]:
        """Find the objects (names; None: all learnt ones) in one RGB-D image.

        `rgb` (h, w, 3) uint8, red first. `depth` (h, w) floating point in metres along the optical
        axis, registered to `rgb`, 0 or NaN where missing. `camera_matrix` (3, 3) in pixels, with
        pixel centres at integers. All instances of each object are returned, at most
        `max_instances`, if their poses are right with a probability of at least `min_score`. The
        most certain detection comes first. `search` also tells why an object is not among them.

        Raises InputError naming the argument that is wrong.
        """
        found = self.search(rgb, depth, camera_matrix, objects, max_instances, min_score)
        return found.detections

    def search(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        objects: Sequence[str] | None = None,
        max_instances: int = MOST_INSTANCES,
        min_score: float = MIN_SCORE,
    ) -> SearchResult:
        """What `detect` returns, and for each object why it has no other detection."""
        frame = _checked_frame(rgb, depth, camera_matrix)
        names = self._checked_names(objects)
        _check_limits(max_instances, min_score)
        answers, missing = [], []
        with self._lock, one_blas_thread(self._blas):
            begun = time.perf_counter()
            context = self._estimator.prepare(frame)
            wanted = {self._ids[name]: max_instances for name in names}
            found, seconds = self._find(context, wanted, min_score, begun)
            for name, object_id in ((name, self._ids[name]) for name in names):
                refined = found[object_id]
                if refined is None:
                    missing.append(name)
                    continue
                answers += describe(
                    self._estimator, context, object_id, refined, seconds[object_id]
                )
        return sort_answers(answers, missing, min_score)

    def _find(
        self, context: FrameContext, wanted: Mapping[int, int], min_score: float, begun: float
    ) -> tuple[Found, dict[int, float]]:
        """What stage 3 found of the wanted objects, and the time (s) of each."""
        found: Found = {}
        estimator, regions, hypotheses, seconds = self._estimator, {}, {}, {}
        for object_id, count in wanted.items():
            region = estimator.find_region(context, object_id)
            coarse = estimator.find_hypotheses(context, region).hypotheses
            found[object_id] = find_instances(
                estimator, context, region, coarse, count, min_score=min_score
            )
            regions[object_id], hypotheses[object_id] = region, coarse
            seconds[object_id] = time.perf_counter() - begun
            begun = time.perf_counter()
        found = resolve_conflicts(estimator, context, found, regions, hypotheses, wanted, min_score)
        shared = (time.perf_counter() - begun) / max(len(wanted), 1)
        return found, {object_id: spent + shared for object_id, spent in seconds.items()}

    def _checked_names(self, objects: Sequence[str] | None) -> Sequence[str]:
        if objects is None:
            return self.objects
        if isinstance(objects, str):
            raise InputError(f"objects is the text {objects!r}: give a list of names")
        names = list(dict.fromkeys(objects))
        unknown = [str(name) for name in names if name not in self._ids]
        if unknown:
            known = ", ".join(self.objects)
            raise InputError(f"objects: {', '.join(unknown)} not learnt; {self.folder} has {known}")
        return names


def _check_limits(max_instances: int, min_score: float) -> None:
    if max_instances < 1:
        raise InputError(f"max_instances is {max_instances}: it must be at least 1")
    if not 0.0 <= min_score <= 1.0:
        raise InputError(f"min_score is {min_score}: it must be a probability, 0 to 1")


def _checked_frame(rgb: object, depth: object, camera_matrix: object) -> Frame:
    """The arguments of `detect` as a frame. Raises InputError naming what is wrong."""
    color = np.asarray(rgb)
    if color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8:
        raise InputError(f"rgb is {color.dtype} {color.shape}: it must be uint8 (h, w, 3)")
    distance = np.asarray(depth)
    if distance.ndim != 2 or distance.dtype.kind != "f":
        raise InputError(
            f"depth is {distance.dtype} {distance.shape}: it must be floating point (h, w), in "
            "metres; for millimetres in uint16: depth / 1000"
        )
    if distance.shape != color.shape[:2]:
        raise InputError(f"depth is {distance.shape}, rgb {color.shape[:2]}: they must be alike")
    distance = np.where(np.isfinite(distance), distance, 0.0).astype(np.float32)
    if (distance < 0).any():
        raise InputError("depth has negative values: metres, 0 where missing")
    present = distance[distance > 0]
    if len(present) and np.median(present) > _FARTHEST:
        raise InputError(
            f"depth has a median of {np.median(present):.4g} m: it must be in metres, is it in mm?"
        )
    return Frame(0, 0, color, distance, _checked_camera(camera_matrix, distance.shape))


def _checked_camera(given: object, shape: tuple[int, ...]) -> Float[np.ndarray, "3 3"]:
    try:
        camera = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"camera_matrix must be 3 × 3 numbers, not {given!r}") from error
    if camera.shape != (3, 3) or not np.isfinite(camera).all():
        raise InputError(f"camera_matrix must be 3 × 3 finite numbers, not {given!r}")
    if not np.array_equal(camera[[1, 2, 2, 2], [0, 0, 1, 2]], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"camera_matrix is {camera.tolist()}: its rows must be fx 0 cx, 0 fy cy, 0 0 1"
        )
    height, width = shape
    if camera[0, 0] <= 0 or camera[1, 1] <= 0:
        raise InputError("camera_matrix: both focal lengths must be positive")
    if not (0 <= camera[0, 2] < width and 0 <= camera[1, 2] < height):
        raise InputError(
            f"camera_matrix: the principal point ({camera[0, 2]:g}, {camera[1, 2]:g}) lies outside "
            f"the image ({width} × {height}): it belongs to images of another size"
        )
    return camera
