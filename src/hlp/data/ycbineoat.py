"""Sequences as YCBInEOAT (Wen et al., ICRA 2020) stores them: one object, a pose for each frame.

`rgb/*.png`, `depth/*.png` (mm), `cam_K.txt` (3×3, pixels) and `annotated_poses/*.txt` (4×4, object
to camera, metres). The object's mesh lies elsewhere.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from hlp.arrays import Pose
from hlp.data.camera_files import read_camera
from hlp.data.dataset import DATASETS, Dataset, StatedTarget, content_hash
from hlp.data.file_frames import (
    FileFrames,
    FolderSettings,
    StatedFrame,
    existing_folder,
    read_numbers,
)
from hlp.data.frame_paths import list_images
from hlp.data.images import EXTENSIONS, find_image
from hlp.errors import DataError, MissingFileError
from hlp.geometry import rigid
from hlp.objects.object_model import ObjectSettings, build_object_model
from hlp.records import Target, frame_key
from hlp.schemas import exact_rotation
from hlp.settings import Doc, Positive, PositiveOrNone

_OBJECT_ID = 1
_SCENE_ID = 0
_CAMERA, _POSES = "cam_K.txt", "annotated_poses"


@DATASETS.register
@dataclass(frozen=True, kw_only=True)
class YcbineoatSettings(FolderSettings):
    """Config group `data`: a sequence in YCBInEOAT's layout.

    `rgb/`, `depth/`, `cam_K.txt` and `annotated_poses/`; the poses are those of one object.
    """

    name: Literal["ycbineoat"] = "ycbineoat"
    root: Annotated[str, Doc("folder of the sequence")]
    mesh: Annotated[str, Doc("the object's mesh")]
    object: Annotated[str | None, Doc("the object's name; null: that of the mesh")] = None
    mesh_scale: Annotated[
        PositiveOrNone, Doc("metres per unit of the mesh; null: guessed from its size")
    ] = None
    depth_scale: Annotated[Positive, Doc("mm per unit of the depth images")] = 1.0

    def build(self) -> Dataset:
        """The object and the frames. Raises MissingFileError and DataError naming what is wrong."""
        root = existing_folder("data.root", self.root)
        images = self.training_images()
        mesh = Path(self.mesh)
        if not mesh.is_file():
            raise MissingFileError(f"data.mesh is not a file: {mesh} (set data.mesh=FILE)")
        name = mesh.stem if self.object is None else self.object
        own = ObjectSettings(_OBJECT_ID)
        model = build_object_model(name, own, mesh, self.mesh_scale, self.proxy_faces)
        frames = YcbineoatFrames(root, self.depth_scale, max_megapixels=self.max_megapixels)
        models = {_OBJECT_ID: model}
        return Dataset(models, tuple(models), frames, **vars(images), settings=self)


def read_pose(path: Path) -> Pose:
    """The pose in a file: 16 numbers, row by row, its rotation made exact.

    Raises MissingFileError, and DataError for anything that is not a rigid motion.
    """
    pose = read_numbers(path, 16).reshape(4, 4)
    if not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise DataError(f"{path} is not a pose: it must be R t / 0 0 0 1, translation in metres")
    return rigid(exact_rotation(pose[:3, :3], str(path)), pose[:3, 3])


@dataclass(eq=False)
class YcbineoatFrames(FileFrames):
    """The frames of a sequence, with one target each (a `FrameSource`).

    Frames are numbered in the order of their names. A pose belongs to the image of its name; if no
    name is in both, they are paired in their order.
    """

    depth_scale: float = 1.0

    unit = "metres"

    @cached_property
    def _entries(self) -> dict[str, tuple[Path, Path, Path]]:
        """Colour image, pose and depth image of each frame."""
        images, poses = (
            list_images(str(existing_folder("data.root", str(self.root / name))), name, extensions)
            for name, extensions in (("rgb", EXTENSIONS), (_POSES, (".txt",)))
        )
        by_name = {path.stem: path for path in poses}
        if by_name.keys().isdisjoint(path.stem for path in images):
            if len(images) != len(poses):
                raise DataError(
                    f"{self.root} has {len(images)} images and {len(poses)} poses of other names: "
                    "there must be one for each image"
                )
            by_name = {image.stem: pose for image, pose in zip(images, poses, strict=True)}
        posed, depths = [path for path in images if path.stem in by_name], self.root / "depth"
        return {
            frame_key(_SCENE_ID, i): (image, by_name[image.stem], find_image(depths, image.stem))
            for i, image in enumerate(posed)
        }

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """See `CheckedFrames`."""
        return ((_OBJECT_ID, float("nan")),)

    def identity(self) -> str:
        """Hash of images, poses and intrinsics, and of what is missing."""
        files = [path for paths in self._entries.values() for path in paths]
        return content_hash([self.root / _CAMERA, *files], repr(self.depth_scale))

    def _stated(self, key: str) -> StatedFrame:
        color, pose, depth = self._entries[key]
        camera = str(self.root / _CAMERA)
        targets = [(Target(_OBJECT_ID, read_pose(pose)), str(pose))]
        matrix = read_camera(camera).matrix
        return StatedFrame(color, depth, self.depth_scale, matrix, camera, targets)
