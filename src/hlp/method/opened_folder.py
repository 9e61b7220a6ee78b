"""A folder of learnt objects as a detector keeps it: objects are learnt into it, added, removed."""

import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from typing import Self

from threadpoolctl import ThreadpoolController

from hlp.errors import MissingFileError
from hlp.method import arguments
from hlp.method.find.estimator import PoseEstimator
from hlp.method.learn.learnt_folder import LearntFolder
from hlp.method.learn.unfinished_folder import left_behind
from hlp.method.settings import Device, FindSettings, MethodSettings
from hlp.patches.backgrounds import GivenBackgrounds
from hlp.records import Frame, ObjectModel
from hlp.threads import one_blas_thread

AnyPath = str | PathLike[str]


class OpenedFolder:
    """Learnt objects in a folder, and the estimator that finds them, for one thread at a time.

    `Detector` adds what is done with images.
    """

    def __init__(
        self, folder: AnyPath, threads: int | None = None, device: Device | None = None
    ) -> None:
        """Open a folder of learnt objects; see `load`."""
        # Files are read later, from any working directory.
        self.folder = arguments.checked_path(folder, "folder").resolve()
        self._threads, self._device = threads, device
        self._lock = threading.Lock()
        self._blas = ThreadpoolController()
        self._open()

    def __reduce__(self) -> tuple[type[Self], tuple[object, ...]]:
        """Pickled as the name of its folder: another process opens the folder itself."""
        return type(self), (self.folder, self._threads, self._device)

    def __repr__(self) -> str:
        settings, objects = self._settings, list(self.objects)
        chosen = ", ".join(
            f"{group}={getattr(settings, group).name}"
            for group in ("encoder", "codebook", "refinement")
        )
        about = f"{str(self.folder)!r}, {objects=}, {chosen}, threads={self.threads}"
        return f"{type(self).__name__}({about})"

    def _open(self) -> None:
        if (left := left_behind(self.folder)) is not None:
            raise MissingFileError(
                f"{self.folder} is missing: a process was killed while replacing it. Rename {left} "
                "to it, then call again"
            )
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
    ) -> Self:
        """Learn objects from their CAD models into a new folder. This takes minutes on two cores.

        Repeat an interrupted call to continue it. Progress is shown on a terminal. Sets the threads
        of torch, OpenCV and BLAS in this process.

        Args:
            meshes: names and files (PLY, OBJ, STL, …).
            folder: must not exist yet.
            settings: None: the defaults.
            mesh_scale: metres per unit of the files (0.001: millimetres); None: guessed, logged.
            background_frames: RGB-D frames without the objects, better than procedural ones.

        Returns:
            A detector of these objects.

        Raises:
            InputError: an argument is wrong, or the folder exists already.
            MissingFileError: there is no such mesh.
            DataError: a mesh has no triangles or cannot be read.

        Examples:
            >>> meshes = {"bear": "bear.ply", "can": "can.ply"}
            >>> detector = Detector.learn(meshes, "learnt", mesh_scale=0.001)  # doctest: +SKIP
        """
        from hlp.method.learn.learning import learn  # with torch, which takes seconds

        settings = arguments.checked_settings(settings, MethodSettings)
        target = arguments.checked_path(folder, "folder")
        backgrounds = GivenBackgrounds(arguments.checked_backgrounds(background_frames))
        learn(_build_models(meshes, mesh_scale, 1), target, settings, backgrounds)
        return cls(folder)

    @classmethod
    def load(
        cls, folder: AnyPath, *, threads: int | None = None, device: Device | None = None
    ) -> Self:
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
        meshes: Mapping[str, AnyPath],
        *,
        mesh_scale: float | None = None,
        background_frames: Iterable[Frame] = (),
    ) -> None:
        """Learn more objects into the folder, which takes minutes.

        The encoder stays as it is and the classifier is trained further.

        Args:
            meshes: names and files, as in `learn`.
            mesh_scale: metres per unit of the files, or None.
            background_frames: as in `learn`.

        Raises:
            InputError: an argument is wrong, or an object has a name that is taken.

        Examples:
            >>> detector.add({"cat": "cat.ply"}, mesh_scale=0.001)  # doctest: +SKIP
        """
        from hlp.method.learn.learning import add

        with self._lock:
            classes = LearntFolder(self.folder).record.classes  # of removed objects, too
            first_id = max(classes, default=0) + 1
            backgrounds = GivenBackgrounds(arguments.checked_backgrounds(background_frames))
            add(self.folder, _build_models(meshes, mesh_scale, first_id), backgrounds)
            self._open()

    def remove(self, name: str) -> None:
        """Take an object out of the folder.

        Args:
            name: the object's.

        Raises:
            InputError: there is no such object, or no other one.

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
        """Load all networks and codebooks now instead of at the first `detect`.

        Examples:
            >>> detector.warm_up()
        """
        with self._lock:
            self._estimator.load(tuple(self._ids.values()))

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
    paths = arguments.checked_meshes(meshes)
    return build_models(paths, dict.fromkeys(paths, choices), first_id)
