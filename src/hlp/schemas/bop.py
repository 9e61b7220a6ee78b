"""The JSON files of BOP: scenes, lists of targets, models (millimetres, pixels).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit. Keys that are
not named here are not read.
"""

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StrictStr

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Id = Annotated[int, Field(ge=0)]


def _flat(values: Any) -> Any:
    """Rows of a matrix as one list."""
    if isinstance(values, list) and values and all(isinstance(row, list) for row in values):
        return [number for row in values for number in row]
    return values


_Matrix3 = Annotated[list[_Finite], BeforeValidator(_flat), Field(min_length=9, max_length=9)]
_Matrix4 = Annotated[list[_Finite], BeforeValidator(_flat), Field(min_length=16, max_length=16)]
_Vector3 = Annotated[list[_Finite], BeforeValidator(_flat), Field(min_length=3, max_length=3)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class CameraEntry(_Entry):
    """A frame's entry in scene_camera.json; also camera.json of a folder of frames."""

    cam_K: _Matrix3  # noqa: N815
    depth_scale: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0


class TruthEntry(_Entry):
    """An annotated instance in scene_gt.json."""

    obj_id: _Id
    cam_R_m2c: _Matrix3  # noqa: N815
    cam_t_m2c: _Vector3


class InfoEntry(_Entry):
    """What scene_gt_info.json says of an annotated instance."""

    visib_fract: Annotated[float, Field(ge=0, le=1)] = float("nan")


class TargetRow(_Entry):
    """A row of a list of targets; that of 2024 names frames alone."""

    scene_id: _Id
    im_id: _Id
    obj_id: _Id | None = None
    inst_count: Annotated[int, Field(ge=1)] = 1


class ContinuousSymmetry(_Entry):
    """An axis of revolution."""

    axis: _Vector3
    offset: _Vector3


class ModelInfo(_Entry):
    """An object's entry in models_info.json."""

    diameter: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    symmetries_discrete: list[_Matrix4] = []
    symmetries_continuous: list[ContinuousSymmetry] = []


class RunLengths(_Entry):
    """A mask: COCO's uncompressed run lengths, column by column, beginning with zeros."""

    size: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=2)]
    counts: list[_Id]


Scene = dict[StrictStr, Any]
"""A scene's file: an entry for each frame, which is checked when the frame is."""
Truths = list[TruthEntry]
Infos = list[InfoEntry]
Targets = list[TargetRow]
ModelInfos = dict[StrictStr, ModelInfo]
Names = dict[StrictStr, Annotated[StrictStr, Field(pattern=r"^\w[\w .+-]*$")]]
"""Names of objects, which become names of files."""


def whole_ids(names: Sequence[str]) -> list[int]:
    """Ids that are keys of an object, as numbers. Raises ValueError for another key."""
    for name in names:
        if not (name.isascii() and name.isdecimal()) or str(int(name)) != name:
            raise ValueError(f"the key {name!r} is no id: it must be a whole number from 0")
    return [int(name) for name in names]
