"""LINEMOD in its original layout (Hinterstoisser et al., ACCV 2012), one folder per object.

`OBJ/data/colorN.jpg`, `depthN.dpt`, `rotN.rot`, `traN.tra` and `OBJ/mesh.ply`. Depth is in
millimetres, translations are in centimetres. The intrinsics are in no file but in the
configuration.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Unit
from jaxtyping import Float, UInt16

from hlp.data.dataset import DATASETS, Dataset, StatedTarget, content_hash
from hlp.data.images import (
    camera_matrix,
    depth_metres,
    image_size,
    read_rgb,
    require_same_size,
    same_size,
)
from hlp.data.training_images import MAX_MEGAPIXELS, FolderSettings, existing_folder
from hlp.errors import DataError, MissingFileError
from hlp.geometry import nearest_rotation, rigid, transform
from hlp.objects.object_model import ObjectSettings, build_object_model, check_unique
from hlp.records import Frame, ObjectModel, Target, frame_key
from hlp.schemas.meaning import (
    require_camera,
    require_depths,
    require_in_front,
    require_near_depths,
    require_rotation,
)
from hlp.settings import Doc

_CENTIMETRE = 1e-2  # m
_HEADER_BYTES = 8


@DATASETS.register
@dataclass(frozen=True, kw_only=True)
class LinemodSettings(FolderSettings):
    """Config group `data`: a data set in LINEMOD's first layout (ACCV 2012).

    `OBJ/mesh.ply`, `OBJ/data/colorN.jpg`, `depthN.dpt`, `rotN.rot`, `traN.tra`.
    """

    name: Literal["linemod"] = "linemod"
    root: Annotated[str, Doc("folder with one folder per object")]
    objects: Annotated[
        dict[str, ObjectSettings],
        Doc("objects by the names of their folders (rename benchviseblue to benchvise)"),
    ]
    camera_matrix: Annotated[
        tuple[float, ...], Unit("px"), Doc("intrinsics, which are not in the data set's files (P)")
    ] = (572.4114, 0.0, 325.2611, 0.0, 573.57043, 242.04899, 0.0, 0.0, 1.0)
    mesh_scale: Annotated[
        float, Gt(0), Doc("metres per unit of mesh.ply: 0.001 for millimetres, 1 for metres")
    ] = 0.001

    def build(self) -> Dataset:
        """Objects and frames. Raises FileNotFoundError and ValueError naming what is wrong."""
        root = existing_folder("data.root", self.root)
        training = self.training_images()
        models = load_object_models(root, self.objects, self.proxy_faces, self.mesh_scale)
        ids = {name: each.id for name, each in self.objects.items()}
        frames = LinemodFrames(root, ids, self.camera_matrix, self.max_megapixels)
        return training.dataset(models, tuple(models), frames, self)


def read_dpt(path: Path) -> UInt16[np.ndarray, "h w"]:
    """Raw depth (mm): rows and columns as int32, then rows x columns uint16, little-endian.

    Raises FileNotFoundError, and ValueError if the length does not match the header.
    """
    if not path.is_file():
        raise MissingFileError(f"no depth {path}")
    columns, rows = dpt_size(path)
    content = path.read_bytes()
    return np.frombuffer(content, "<u2", offset=_HEADER_BYTES).reshape(rows, columns)


def dpt_size(path: Path) -> tuple[int, int]:
    """Width and height of a .dpt file. Raises what `read_dpt` raises."""
    if not path.is_file():
        raise MissingFileError(f"no depth {path}")
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES).ljust(_HEADER_BYTES, b"\0")
    rows, columns = (int(each) for each in np.frombuffer(header, "<i4"))
    if rows < 1 or columns < 1 or path.stat().st_size != _HEADER_BYTES + 2 * rows * columns:
        raise DataError(f"{path} is truncated or no .dpt file: copy or download it again")
    return columns, rows


def read_matrix(path: Path, count: int) -> Float[np.ndarray, "n"]:
    """The `count` numbers of a .rot or .tra file, after its header line (rows and columns).

    Raises FileNotFoundError, and ValueError for another number of values, NaN or infinity.
    """
    if not path.is_file():
        raise MissingFileError(f"no pose {path}")
    try:
        words = " ".join(path.read_text(encoding="utf-8").splitlines()[1:]).split()
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise DataError(f"{path} holds something that is no number ({error})") from error
    if len(values) != count or not np.isfinite(values).all():
        raise DataError(f"{path} must hold a header line and {count} finite numbers")
    return values


def load_object_models(
    root: Path, objects: Mapping[str, ObjectSettings], proxy_faces: int, mesh_scale: float
) -> dict[int, ObjectModel]:
    """Object models by id from `OBJ/mesh.ply`, times `mesh_scale` (metres per unit of the file).

    The layout has neither diameters nor symmetries: the diameter is the largest distance between
    two vertices, the symmetries are found in the meshes. Raises what `build_object_model` raises.
    """
    check_unique(objects)
    return {
        settings.id: build_object_model(
            name, settings, root / name / "mesh.ply", mesh_scale, proxy_faces
        )
        for name, settings in objects.items()
    }


class LinemodFrames:
    """All frames of the given objects, with one target each (a `FrameSource`).

    Constructing it reads no file. `object_ids` maps folder names to ids; the id is also the scene
    id of the frames, as in BOP's version.
    """

    def __init__(
        self,
        root: Path,
        object_ids: Mapping[str, int],
        camera: Sequence[float],
        max_megapixels: float = MAX_MEGAPIXELS,
    ) -> None:
        self._root, self._max_megapixels = Path(root), max_megapixels
        self._names = {object_id: name for name, object_id in object_ids.items()}
        self._camera = camera_matrix(list(camera), Path("data.camera_matrix"))

    @cached_property
    def _frames(self) -> dict[str, tuple[int, int]]:
        frames: dict[str, tuple[int, int]] = {}
        for object_id in sorted(self._names):
            folder = self._folder(object_id)
            numbers = [path.stem.removeprefix("color") for path in folder.glob("color*.jpg")]
            for number in sorted(int(text) for text in numbers if text.isdigit()):
                frames[frame_key(object_id, number)] = (object_id, number)
        if not frames:
            raise MissingFileError(
                f"no OBJ/data/color*.jpg under {self._root} for the objects"
                f" {', '.join(self._names.values())}: check data.root"
            )
        return frames

    @property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, `<object id>_<frame number>`."""
        return tuple(self._frames)

    def __len__(self) -> int:
        return len(self._frames)

    def load(self, key: str) -> Frame:
        """Decode one frame. Raises KeyError, FileNotFoundError, or ValueError for a broken file."""
        if key not in self._frames:
            raise KeyError(f"no frame {key!r} under {self._root}")
        object_id, number = self._frames[key]
        color, dpt, _, tra = self._files(object_id, number)
        rgb = read_rgb(color)
        depth = depth_metres(read_dpt(dpt), 1.0, dpt)
        same_size(color, rgb, depth)
        require_depths(depth, str(dpt))
        pose = self._pose(object_id, number)
        require_near_depths(pose[:3, 3], depth, str(tra))
        return Frame(object_id, number, rgb, depth, self._camera, (Target(object_id, pose),))

    def check(self, key: str, models: Mapping[int, ObjectModel]) -> None:
        """See `CheckedFrames`."""
        object_id, number = self._frames[key]
        color, dpt, _, tra = self._files(object_id, number)
        size = image_size(color, self._max_megapixels)
        require_same_size(color, size, dpt_size(dpt))
        require_camera(self._camera, size, "data.camera_matrix")
        pose, model = self._pose(object_id, number), models[object_id]
        center = transform(pose, model.centroid[None])[0]
        require_in_front(center, model.diameter, str(tra), "centimetres")

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """See `CheckedFrames`."""
        return (StatedTarget(self._frames[key][0]),)

    def _pose(self, object_id: int, number: int) -> Float[np.ndarray, "4 4"]:
        _, _, rot, tra = self._files(object_id, number)
        rotation = read_matrix(rot, 9).reshape(3, 3)
        require_rotation(rotation, str(rot))
        return np.asarray(rigid(nearest_rotation(rotation), read_matrix(tra, 3) * _CENTIMETRE))

    def identity(self) -> str:
        """Hash of images, poses and intrinsics, and of what is missing."""
        files = [path for frame in self._frames.values() for path in self._files(*frame)]
        missing = [path.name for path in files if not os.access(path, os.R_OK)]
        said = repr((list(self._frames), self._camera.tolist())) + (
            repr(missing) if missing else ""
        )
        return content_hash([path for path in files if os.access(path, os.R_OK)], extra=said)

    def _folder(self, object_id: int) -> Path:
        return self._root / self._names[object_id] / "data"

    def _files(self, object_id: int, number: int) -> tuple[Path, Path, Path, Path]:
        names = (f"color{number}.jpg", f"depth{number}.dpt", f"rot{number}.rot", f"tra{number}.tra")
        color, dpt, rot, tra = (self._folder(object_id) / name for name in names)
        return color, dpt, rot, tra
