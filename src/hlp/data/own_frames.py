"""A user's own CAD model and frames: colour and depth images, intrinsics, no true poses."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt
from jaxtyping import Float

from hlp.data.dataset import DATASETS, Dataset
from hlp.data.images import (
    EXTENSIONS,
    camera_matrix,
    find_image,
    read_depth,
    read_rgb,
    same_size,
)
from hlp.data.sources import content_hash
from hlp.data.training_images import FolderSettings
from hlp.errors import InputError, MissingFileError
from hlp.files import read_json
from hlp.objects.object_model import ObjectSettings, build_object_model
from hlp.records import Frame, ObjectModel, frame_key, parse_frame_key
from hlp.settings import Doc

OBJECT_ID = 1
_SCENE_ID = 0


@DATASETS.register
@dataclass(frozen=True, kw_only=True)
class FilesSettings(FolderSettings):
    """Config group `data`: your own object and frames, without true poses (`hlp predict`)."""

    name: Literal["files"] = "files"
    model: Annotated[str, Doc("the CAD model: PLY, OBJ, STL …")]
    rgb: Annotated[str, Doc("a colour image, or a folder of them")]
    depth: Annotated[
        str, Doc("its 16-bit depth PNG, registered to rgb, or a folder of them with the same names")
    ]
    intrinsics: Annotated[
        str | list[float],
        Doc("JSON file with cam_K (nine numbers) or fx, fy, cx, cy; or [fx,fy,cx,cy] (px)"),
    ]
    mesh_scale: Annotated[
        float, Gt(0), Doc("metres per unit of the model: 0.001 for millimetres, 1 for metres")
    ] = 0.001
    depth_scale: Annotated[
        float | None,
        Gt(0),
        Doc("mm per unit of the depth images; null: the JSON file's, else 1"),
    ] = None
    holistic_size_mm: Annotated[
        float | None, Gt(0), Doc("side of the windows; null: computed from the mesh")
    ] = None
    local_size_mm: Annotated[
        float | None, Gt(0), Doc("side of the local patches; null: computed from the mesh")
    ] = None

    def build(self) -> Dataset:
        """Object and frames. Raises FileNotFoundError and ValueError naming what is wrong."""
        training = self.training_images()
        model = load_object_model(self)
        models = {model.object_id: model}
        frames = OwnFrames(Path(self.rgb), Path(self.depth), self.intrinsics, self.depth_scale)
        return training.dataset(models, tuple(models), frames, self, annotated=False)


def load_object_model(settings: FilesSettings) -> ObjectModel:
    """The object, named after its mesh file. Raises what `load_mesh` raises, naming the key."""
    path = Path(settings.model)
    sizes = ObjectSettings(OBJECT_ID, settings.holistic_size_mm, settings.local_size_mm)
    try:
        return build_object_model(path.stem, sizes, path, settings.mesh_scale, settings.proxy_faces)
    except FileNotFoundError as error:
        raise MissingFileError(f"model is no file: {path} (set model=FILE)") from error
    except ValueError as error:
        raise InputError(f"model: {error}; the unit is mesh_scale") from error


def read_intrinsics(given: str | list[float]) -> tuple[Float[np.ndarray, "3 3"], float]:
    """Camera matrix (px) and depth scale (mm per unit of the depth images, by default 1).

    `given` is a JSON file with `cam_K` (9 numbers) or `fx, fy, cx, cy`, and optionally
    `depth_scale`; or the nine or four numbers themselves. Raises FileNotFoundError, and ValueError
    for anything else.
    """
    if not isinstance(given, str):
        return _matrix(given, "intrinsics"), 1.0
    path = Path(given)
    if not path.is_file():
        raise MissingFileError(
            f"intrinsics is no file: {path} (set intrinsics=FILE.json or intrinsics=[fx,fy,cx,cy])"
        )
    camera = read_json(path)
    where = f"intrinsics, {path}"
    if isinstance(camera, dict) and "cam_K" in camera:
        values = camera["cam_K"]
    elif isinstance(camera, dict) and {"fx", "fy", "cx", "cy"} <= camera.keys():
        values = [camera[key] for key in ("fx", "fy", "cx", "cy")]
    else:
        raise InputError(f"{where}: no cam_K (nine numbers), nor fx, fy, cx and cy")
    scale = camera.get("depth_scale", 1.0)
    if not isinstance(scale, int | float):
        raise InputError(f"{where}: depth_scale must be a number, not {scale!r}")
    return _matrix(values, where), float(scale)


def _matrix(values: Any, where: str) -> Float[np.ndarray, "3 3"]:
    flat = np.ravel(values).tolist() if isinstance(values, list) else []
    if len(flat) == 4:
        flat = [flat[0], 0.0, flat[2], 0.0, flat[1], flat[3], 0.0, 0.0, 1.0]
    if len(flat) != 9:
        raise InputError(f"{where}: {values!r} is neither nine numbers of K nor [fx,fy,cx,cy]")
    matrix = camera_matrix(flat, Path(where))
    if not np.array_equal(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(f"{where}: {flat} is no camera matrix, row by row: fx 0 cx 0 fy cy 0 0 1")
    return matrix


class OwnFrames:
    """Frames without true poses (a `FrameSource`). Constructing it reads no file.

    `rgb` and `depth` are one image each, or one folder each with images of the same names apart
    from the extension. Frames are numbered in the order of their names.
    """

    def __init__(
        self, rgb: Path, depth: Path, intrinsics: str | list[float], depth_scale: float | None
    ) -> None:
        self._rgb, self._depth, self._intrinsics = rgb, depth, intrinsics
        self._depth_scale = depth_scale

    @cached_property
    def _camera(self) -> tuple[Float[np.ndarray, "3 3"], float]:
        matrix, stated = read_intrinsics(self._intrinsics)
        scale = stated if self._depth_scale is None else self._depth_scale
        if not 0 < scale < float("inf"):
            raise InputError(f"depth_scale is {scale}: it must be mm per unit of the depth images")
        return matrix, scale

    @cached_property
    def _paths(self) -> dict[str, tuple[Path, Path]]:
        for key, path in (("rgb", self._rgb), ("depth", self._depth)):
            if not path.exists():
                raise MissingFileError(
                    f"{key} is no image and no folder: {path} (set {key}=IMAGE or {key}=FOLDER)"
                )
        images = [self._rgb]
        if self._rgb.is_dir():
            images = sorted(p for p in self._rgb.iterdir() if p.suffix.lower() in EXTENSIONS)
        if not images:
            raise MissingFileError(f"rgb: no image in {self._rgb}")
        for first, second in pairwise(images):
            if first.stem == second.stem:
                raise InputError(f"rgb: {first} and {second} have one name: remove one of them")
        return {
            frame_key(_SCENE_ID, number): (path, self._partner(path))
            for number, path in enumerate(images)
        }

    def _partner(self, image: Path) -> Path:
        if not self._depth.is_dir():
            if self._rgb.is_dir():
                raise InputError("depth is one image and rgb is a folder: give two of a kind")
            return self._depth
        try:
            return find_image(self._depth, image.stem)
        except FileNotFoundError as error:
            raise MissingFileError(
                f"depth: {self._depth} has no {image.stem}.png for the rgb image {image}"
            ) from error

    @property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, numbered in the order of the file names."""
        return tuple(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def image(self, key: str) -> Path:
        """Path of a frame's colour image."""
        return self._paths[key][0]

    def load(self, key: str) -> Frame:
        """Decode one frame. Raises KeyError, FileNotFoundError, or ValueError for a broken file."""
        if key not in self._paths:
            raise KeyError(f"no frame {key!r} in {self._rgb}")
        color, depth_path = self._paths[key]
        matrix, scale = self._camera
        rgb = read_rgb(color)
        depth = read_depth(depth_path, scale)
        same_size(color, rgb, depth)
        height, width = depth.shape
        if not (0 <= matrix[0, 2] < width and 0 <= matrix[1, 2] < height):
            raise InputError(
                f"intrinsics: the principal point ({matrix[0, 2]:g}, {matrix[1, 2]:g}) lies outside"
                f" {color} ({width}x{height}): they belong to images of another size"
            )
        return Frame(*parse_frame_key(key), rgb, depth, matrix)

    def identity(self) -> str:
        """Hash of images and intrinsics."""
        matrix, scale = self._camera
        files = [path for pair in self._paths.values() for path in pair]
        return content_hash(files, extra=f"{matrix.tolist()} {scale}")
