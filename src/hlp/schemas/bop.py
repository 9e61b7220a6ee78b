"""The JSON files of BOP: scenes, lists of targets, models (millimetres, pixels).

Format: Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit. Keys that are
not named here are not read.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from annotated_types import Ge, Le, Len

from hlp.settings import Count, Positive, ReadBy, SettingsError, Share, Stored, shown

_Id = Annotated[int, Ge(0), Le(2**31 - 1)]


def _flat(values: Any) -> Any:
    """Rows of a matrix as one list."""
    if isinstance(values, list) and values and all(isinstance(row, list) for row in values):
        return [number for row in values for number in row]
    return values


_Vector3 = Annotated[tuple[float, ...], Len(3, 3), ReadBy(_flat)]
_Matrix3 = Annotated[tuple[float, ...], Len(9, 9), ReadBy(_flat)]
_Matrix4 = Annotated[tuple[float, ...], Len(16, 16), ReadBy(_flat)]


@dataclass(frozen=True)
class CameraEntry(Stored):
    """A frame's entry in scene_camera.json; also camera.json of a folder of frames."""

    cam_K: _Matrix3  # noqa: N815
    depth_scale: Positive = 1.0


@dataclass(frozen=True)
class TruthEntry(Stored):
    """An annotated instance in scene_gt.json."""

    obj_id: _Id
    cam_R_m2c: _Matrix3  # noqa: N815
    cam_t_m2c: _Vector3


@dataclass(frozen=True)
class InfoEntry(Stored):
    """What scene_gt_info.json says of an annotated instance; None where it says nothing."""

    visib_fract: Share | None = None


@dataclass(frozen=True)
class TargetRow(Stored):
    """A row of a list of targets; that of 2024 names frames alone."""

    scene_id: _Id
    im_id: _Id
    obj_id: _Id | None = None
    inst_count: Count = 1


@dataclass(frozen=True)
class ContinuousSymmetry(Stored):
    """An axis of revolution."""

    axis: _Vector3
    offset: _Vector3


@dataclass(frozen=True)
class ModelInfo(Stored):
    """An object's entry in models_info.json."""

    diameter: Positive | None = None
    symmetries_discrete: tuple[_Matrix4, ...] = ()
    symmetries_continuous: tuple[ContinuousSymmetry, ...] = ()


@dataclass(frozen=True)
class RunLengths(Stored):
    """A mask: COCO's uncompressed run lengths, column by column, beginning with zeros."""

    size: tuple[Count, Count]
    counts: Any  # whole numbers: there are too many to check each by its type

    def __post_init__(self) -> None:
        """Raise SettingsError naming what is wrong."""
        super().__post_init__()
        counts = self.counts
        if not isinstance(counts, list) or {*map(type, counts)} != {int} or min(counts) < 0:
            problem = f"is {shown(counts)}: it must be a list of whole numbers from 0"
            raise SettingsError("counts", problem)


Scene = dict[str, Any]
"""A scene's file: an entry for each frame, which is checked when the frame is."""
Truths = list[TruthEntry]
Infos = list[InfoEntry]
Targets = list[TargetRow]
ModelInfos = dict[str, ModelInfo]
Names = dict[str, str]


def whole_ids(names: Sequence[str]) -> list[int]:
    """Ids that are keys of an object, as numbers. Raises ValueError for another key."""
    for name in names:
        if not (name.isascii() and name.isdecimal()) or str(int(name)) != name:
            raise ValueError(f"the key {name!r} is no id: it must be a whole number from 0")
    return [int(name) for name in names]
