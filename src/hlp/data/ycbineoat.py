"""Sequences as YCBInEOAT (Wen et al., ICRA 2020) stores them: one object, a pose for each frame.

`rgb/*.png`, `depth/*.png` (mm), `cam_K.txt` (3×3, pixels) and `annotated_poses/*.txt` (4×4, object
to camera, metres). The object's mesh lies elsewhere.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt
from jaxtyping import Float

from hlp.data.camera_files import read_camera
from hlp.data.dataset import DATASETS, Dataset
from hlp.data.frame_paths import natural
from hlp.data.images import EXTENSIONS, find_image, read_depth, read_rgb, same_size
from hlp.data.sources import content_hash
from hlp.data.training_images import FolderSettings, existing_folder
from hlp.errors import DataError, MissingFileError
from hlp.geometry import nearest_rotation, rigid
from hlp.objects.object_model import ObjectSettings, build_object_model
from hlp.records import Frame, Target, frame_key, parse_frame_key
from hlp.settings import Doc

_OBJECT_ID = 1
_SCENE_ID = 0
_CAMERA, _POSES = "cam_K.txt", "annotated_poses"
_TURNED = 0.01  # largest difference from a rotation of what is one but for rounding


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
        float | None, Gt(0), Doc("metres per unit of the mesh; null: guessed from its size")
    ] = None
    depth_scale: Annotated[float, Gt(0), Doc("mm per unit of the depth images")] = 1.0

    def build(self) -> Dataset:
        """The object and the frames. Raises MissingFileError and DataError naming what is wrong."""
        root = existing_folder("data.root", self.root)
        training = self.training_images()
        mesh = Path(self.mesh)
        if not mesh.is_file():
            raise MissingFileError(f"data.mesh is no file: {mesh} (set data.mesh=FILE)")
        name = mesh.stem if self.object is None else self.object
        model = build_object_model(
            name, ObjectSettings(_OBJECT_ID), mesh, self.mesh_scale, self.proxy_faces
        )
        frames = YcbineoatFrames(root, self.depth_scale)
        return training.dataset({_OBJECT_ID: model}, (_OBJECT_ID,), frames, self)


def read_pose(path: Path) -> Float[np.ndarray, "4 4"]:
    """The pose in a file: 16 numbers, row by row, its rotation made exact.

    Raises DataError for anything that is no rigid motion.
    """
    try:
        values = np.loadtxt(path, dtype=np.float64).reshape(4, 4)
    except ValueError as error:
        raise DataError(f"{path} holds no 4x4 matrix: {error}") from error
    rotation = values[:3, :3]
    rigid_values = np.isfinite(values).all() and np.array_equal(values[3], [0, 0, 0, 1])
    if not rigid_values or np.abs(rotation @ rotation.T - np.eye(3)).max() > _TURNED:
        raise DataError(
            f"{path} is no pose: R t / 0 0 0 1 with a rotation R, translation in metres"
        )
    if np.linalg.det(rotation) < 0:
        raise DataError(f"{path} mirrors the object: its rotation has determinant -1")
    return rigid(nearest_rotation(rotation), values[:3, 3])


class YcbineoatFrames:
    """The frames of a sequence, with one target each (a `FrameSource`).

    Constructing it reads no file. Frames are numbered in the order of their names. A pose belongs
    to the image of its name; if no name is in both, they are paired in their order.
    """

    def __init__(self, root: Path, depth_scale: float = 1.0) -> None:
        self._root, self._depth_scale = Path(root), depth_scale

    @cached_property
    def _files(self) -> dict[str, tuple[Path, Path, Path]]:
        """Colour image, depth image and pose of each frame."""
        images = self._sorted("rgb", EXTENSIONS)
        poses = self._sorted(_POSES, (".txt",))
        by_name = {each.stem: each for each in poses}
        if by_name.keys().isdisjoint(each.stem for each in images):
            if len(images) != len(poses):
                raise DataError(
                    f"{self._root} has {len(images)} images and {len(poses)} poses of other names: "
                    "there must be one for each image"
                )
            by_name = {image.stem: pose for image, pose in zip(images, poses, strict=True)}
        posed = [each for each in images if each.stem in by_name]
        return {
            frame_key(_SCENE_ID, number): (
                image,
                find_image(self._root / "depth", image.stem),
                by_name[image.stem],
            )
            for number, image in enumerate(posed)
        }

    def _sorted(self, name: str, extensions: tuple[str, ...]) -> list[Path]:
        folder = self._root / name
        if not folder.is_dir():
            raise MissingFileError(f"{self._root} has no folder {name}: check data.root")
        found = [each for each in folder.iterdir() if each.suffix.lower() in extensions]
        if not found:
            raise MissingFileError(f"{folder} has no file {' or '.join(extensions)}")
        return sorted(found, key=lambda each: natural(each.name))

    @property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, numbered in the order of the file names."""
        return tuple(self._files)

    def __len__(self) -> int:
        return len(self._files)

    def load(self, key: str) -> Frame:
        """Decode one frame. Raises KeyError, FileNotFoundError, or ValueError for a broken file."""
        if key not in self._files:
            raise KeyError(f"no frame {key!r} in {self._root}")
        color, depth_path, pose = self._files[key]
        matrix = read_camera(str(self._root / _CAMERA)).matrix
        rgb = read_rgb(color)
        depth = read_depth(depth_path, self._depth_scale)
        same_size(color, rgb, depth)
        target = Target(_OBJECT_ID, read_pose(pose))
        return Frame(*parse_frame_key(key), rgb, depth, matrix, (target,))

    def identity(self) -> str:
        """Hash of images, poses and intrinsics."""
        files = [path for paths in self._files.values() for path in paths]
        return content_hash([self._root / _CAMERA, *files], extra=repr(self._depth_scale))
