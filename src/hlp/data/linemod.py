"""LINEMOD in its original layout (Hinterstoisser et al., ACCV 2012), one folder per object.

`OBJ/data/colorN.jpg`, `depthN.dpt`, `rotN.rot`, `traN.tra` and `OBJ/mesh.ply`. Depth is in
millimetres, translations are in centimetres. The intrinsics are in the configuration.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Unit

from hlp.arrays import CameraMatrix
from hlp.data.dataset import DATASETS, Dataset, StatedTarget, content_hash
from hlp.data.file_frames import (
    FileFrames,
    FolderSettings,
    StatedFrame,
    existing_folder,
    read_numbers,
)
from hlp.errors import MissingFileError
from hlp.geometry import rigid
from hlp.objects.object_model import ONLY, ObjectSettings, build_object_model, chosen_objects
from hlp.records import Target, frame_key
from hlp.schemas import camera_matrix, exact_rotation
from hlp.settings import Doc, Positive

_CENTIMETRE = 1e-2  # m


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
    only: Annotated[tuple[str, ...] | None, ONLY] = None
    camera_matrix: Annotated[
        tuple[float, ...], Unit("px"), Doc("intrinsics, which are not in the data set's files (P)")
    ] = (572.4114, 0.0, 325.2611, 0.0, 573.57043, 242.04899, 0.0, 0.0, 1.0)
    mesh_scale: Annotated[
        Positive, Doc("metres per unit of mesh.ply: 0.001 for millimetres, 1 for metres")
    ] = 0.001

    def build(self) -> Dataset:
        """Objects and frames. Raises FileNotFoundError and ValueError naming what is wrong.

        The layout has neither diameters nor symmetries: the diameter is the largest distance
        between two vertices, the symmetries are found in the meshes.
        """
        root = existing_folder("data.root", self.root)
        images = self.training_images()
        objects = chosen_objects(self.objects, self.only)
        choices = self.mesh_scale, self.proxy_faces
        models = {
            settings.id: build_object_model(name, settings, root / name / "mesh.ply", *choices)
            for name, settings in objects.items()
        }
        names = {object_id: model.name for object_id, model in models.items()}
        matrix = camera_matrix(self.camera_matrix, "data.camera_matrix")
        frames = LinemodFrames(root, names, matrix, max_megapixels=self.max_megapixels)
        return Dataset(models, tuple(models), frames, **vars(images), settings=self)


@dataclass(eq=False)
class LinemodFrames(FileFrames):
    """All frames of the given objects, with one target each (a `FrameSource`).

    `names` are those of the folders by the object's id, which is also the scene id of the frames,
    as in BOP's version. Frame keys are `<object id>_<frame number>`.
    """

    names: Mapping[int, str]
    matrix: CameraMatrix

    unit = "centimetres"

    @cached_property
    def _entries(self) -> dict[str, tuple[int, int]]:
        """Object and number of each frame."""
        frames: dict[str, tuple[int, int]] = {}
        for object_id, name in sorted(self.names.items()):
            images = (self.root / name / "data").glob("color*.jpg")
            numbers = [path.stem.removeprefix("color") for path in images]
            for number in sorted(int(text) for text in numbers if text.isdecimal()):
                frames[frame_key(object_id, number)] = (object_id, number)
        if not frames:
            raise MissingFileError(
                f"no OBJ/data/color*.jpg under {self.root} for the objects"
                f" {', '.join(self.names.values())}: check data.root"
            )
        return frames

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        """See `CheckedFrames`."""
        return ((self._entries[key][0], float("nan")),)

    def identity(self) -> str:
        """Hash of images, poses and intrinsics, and of what is missing."""
        files = [path for key in self._entries for path in self._files(key)]
        return content_hash(files, repr((list(self._entries), self.matrix.tolist())))

    def _files(self, key: str) -> tuple[Path, Path, Path, Path]:
        """Colour, depth, rotation, translation."""
        object_id, n = self._entries[key]
        folder = self.root / self.names[object_id] / "data"
        color, depth = folder / f"color{n}.jpg", folder / f"depth{n}.dpt"
        return color, depth, folder / f"rot{n}.rot", folder / f"tra{n}.tra"

    def _stated(self, key: str) -> StatedFrame:
        color, depth, rot, tra = self._files(key)
        rotation = exact_rotation(read_numbers(rot, 9, 1).reshape(3, 3), str(rot))
        pose = np.asarray(rigid(rotation, read_numbers(tra, 3, 1) * _CENTIMETRE))
        targets = [(Target(self._entries[key][0], pose), str(tra))]
        return StatedFrame(color, depth, 1.0, self.matrix, "data.camera_matrix", targets)
