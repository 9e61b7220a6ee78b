"""Sequences as YCBInEOAT (Wen et al., ICRA 2020) stores them: one object, a pose for each frame.

`rgb/*.png`, `depth/*.png` (mm), `cam_K.txt` (3×3, pixels) and `annotated_poses/*.txt` (4×4, object
to camera, metres). The object's mesh lies elsewhere.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt
from jaxtyping import Float

from hlp.data.camera_files import read_camera
from hlp.data.dataset import DATASETS, Dataset, StatedTarget, content_hash
from hlp.data.frame_paths import natural
from hlp.data.images import (
    EXTENSIONS,
    depth_image_size,
    find_image,
    image_size,
    read_depth,
    read_rgb,
    require_same_size,
    same_size,
)
from hlp.data.training_images import MAX_MEGAPIXELS, FolderSettings, existing_folder
from hlp.errors import DataError, MissingFileError
from hlp.geometry import nearest_rotation, rigid, transform
from hlp.objects.object_model import ObjectSettings, build_object_model
from hlp.records import Frame, ObjectModel, Target, frame_key, parse_frame_key
from hlp.schemas.meaning import (
    require_camera,
    require_depths,
    require_in_front,
    require_near_depths,
    require_rotation,
)
from hlp.settings import Doc

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
        frames = YcbineoatFrames(root, self.depth_scale, self.max_megapixels)
        return training.dataset({_OBJECT_ID: model}, (_OBJECT_ID,), frames, self)


def read_pose(path: Path) -> Float[np.ndarray, "4 4"]:
    """The pose in a file: 16 numbers, row by row, its rotation made exact.

    Raises MissingFileError, and DataError for anything that is no rigid motion.
    """
    if not path.is_file():
        raise MissingFileError(f"no pose {path}")
    try:
        words = path.read_text(encoding="utf-8").split()
        values = np.array([float(word) for word in words]).reshape(4, 4)
    except ValueError as error:
        raise DataError(f"{path} holds no 4x4 matrix: {error}") from error
    if not np.isfinite(values).all() or not np.array_equal(values[3], [0, 0, 0, 1]):
        raise DataError(f"{path} is no pose: it must be R t / 0 0 0 1, translation in metres")
    require_rotation(values[:3, :3], str(path))
    return rigid(nearest_rotation(values[:3, :3]), values[:3, 3])


class YcbineoatFrames:
    """The frames of a sequence, with one target each (a `FrameSource`).

    Constructing it reads no file. Frames are numbered in the order of their names. A pose belongs
    to the image of its name; if no name is in both, they are paired in their order.
    """

    def __init__(
        self, root: Path, depth_scale: float = 1.0, max_megapixels: float = MAX_MEGAPIXELS
    ) -> None:
        self._root, self._depth_scale = Path(root), depth_scale
        self._max_megapixels = max_megapixels

    @cached_property
    def _files(self) -> dict[str, tuple[Path, Path]]:
        """Colour image and pose of each frame."""
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
            frame_key(_SCENE_ID, number): (image, by_name[image.stem])
            for number, image in enumerate(posed)
        }

    def _depth_file(self, color: Path) -> Path:
        return find_image(self._root / "depth", color.stem)

    @property
    def _camera_matrix(self) -> Float[np.ndarray, "3 3"]:
        return read_camera(str(self._root / _CAMERA)).matrix

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
        color, pose_file = self._files[key]
        depth_file = self._depth_file(color)
        rgb = read_rgb(color)
        depth = read_depth(depth_file, self._depth_scale)
        same_size(color, rgb, depth)
        require_depths(depth, str(depth_file))
        pose = read_pose(pose_file)
        require_near_depths(pose[:3, 3], depth, str(pose_file))
        targets = (Target(_OBJECT_ID, pose),)
        return Frame(*parse_frame_key(key), rgb, depth, self._camera_matrix, targets)

    def check(self, key: str, models: Mapping[int, ObjectModel]) -> None:
        """See `CheckedFrames`."""
        color, pose_file = self._files[key]
        size = image_size(color, self._max_megapixels)
        depth_size = depth_image_size(self._depth_file(color), self._max_megapixels)
        require_same_size(color, size, depth_size)
        require_camera(self._camera_matrix, size, str(self._root / _CAMERA))
        model = models[_OBJECT_ID]
        center = transform(read_pose(pose_file), model.centroid[None])[0]
        require_in_front(center, model.diameter, str(pose_file), "metres")

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """See `CheckedFrames`."""
        if key not in self._files:
            raise KeyError(f"no frame {key!r} in {self._root}")
        return (StatedTarget(_OBJECT_ID),)

    def identity(self) -> str:
        """Hash of images, poses and intrinsics, and of what is missing."""
        files, missing = [self._root / _CAMERA], []
        for color, pose in self._files.values():
            files += [color, pose]
            try:
                files.append(self._depth_file(color))
            except MissingFileError:
                missing.append(color.stem)
        missing += [path.name for path in files if not os.access(path, os.R_OK)]
        said = repr(self._depth_scale) + (repr(missing) if missing else "")
        return content_hash([path for path in files if os.access(path, os.R_OK)], extra=said)
