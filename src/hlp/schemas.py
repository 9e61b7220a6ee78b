"""What files from outside must say: the numbers of any file, and BOP's JSON files.

Functions for numbers raise DataError that begins with `where` and says what is expected: rotations,
places before a camera, cameras, depths. BOP's files are in millimetres and pixels; their format is
that of Hodan et al., BOP (ECCV 2018), docs/bop_datasets_format.md of the BOP toolkit. Keys that are
not named here are not read.
"""

from dataclasses import dataclass, make_dataclass
from types import GenericAlias
from typing import Annotated, Any

import numpy as np
from annotated_types import Le, Len

from hlp.arrays import CameraMatrix, Image, Rotation, Vector
from hlp.errors import DataError
from hlp.geometry import nearest_rotation
from hlp.settings import Count, Positive, Share, Stored, WholeNumber

ROTATION_TOLERANCE = 5e-3
"""Largest difference of a stated rotation's numbers from those of the nearest rotation.

Sets that write three digits differ by 0.0017."""
NEAREST, FARTHEST = 0.05, 20.0
"""Distances (m) between which half of a depth image lies."""
_FARTHEST_OBJECT = 100.0  # m
FOCAL = (0.1, 20.0)
"""Focal lengths, in longer sides of the image."""
_MOST_UNEQUAL = 2.0  # of both focal lengths
_BESIDE = 3.0  # longer sides of the image that a pose may lie beside its middle
SKEW = 0.01
"""Largest skew of a camera, in focal lengths: with more it is another matrix."""
_BEYOND_DEPTH = 10.0  # a pose may be that many times nearer or farther than any depth


def number(text: str) -> float:
    """The number that a text is. Raises ValueError, also for digits in groups (3_00)."""
    if "_" in text:
        raise ValueError(f"{text!r} is no number")
    return float(text)


def exact_rotation(matrix: Rotation, where: str, tolerance: float = ROTATION_TOLERANCE) -> Rotation:
    """The right-handed rotation whose rounded numbers these are."""
    left, sizes, right = np.linalg.svd(matrix)
    nearest = left @ right
    if np.abs(nearest - matrix).max() > tolerance:
        raise DataError(
            f"{where} is not a rotation: its rows must be of length 1 and at right angles, row by "
            f"row (it scales by {sizes.min():.4g} to {sizes.max():.4g})"
        )
    if np.linalg.det(nearest) < 0:
        raise DataError(
            f"{where} is not a rotation but a reflection: take a right-handed coordinate system"
        )
    return nearest_rotation(matrix)


def require_in_front(center_cam: Vector, diameter: float, where: str, unit: str) -> None:
    """An object of that diameter (m), centred at that point of the camera (m), can be seen.

    `unit` is that of the file.
    """
    depth, least = float(center_cam[2]), diameter / 4
    if depth < least or np.linalg.norm(center_cam) > _FARTHEST_OBJECT:
        raise DataError(
            f"{where} places the object of {diameter:.3g} m at {depth:.4g} m from the camera, it "
            f"must be {least:.3g} to {_FARTHEST_OBJECT:g} m before it: translations are in {unit}"
        )


def camera_matrix(values: Any, where: str, size: tuple[int, int] | None = None) -> CameraMatrix:
    """Intrinsics of nine numbers, row by row, of images of that size (width, height).

    Without a size, only the matrix itself is checked.
    """
    try:
        matrix = np.asarray(values, dtype=np.float64).reshape(3, 3)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{where} must hold 9 numbers, not {values!r}") from error
    given = matrix.ravel().tolist()
    if not np.isfinite(matrix).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise DataError(f"{where} is {given}: focal lengths must be finite and positive, in pixels")
    rows = np.allclose(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1])
    if not rows or abs(matrix[0, 1]) > SKEW * matrix[0, 0]:
        raise DataError(f"{where} is {given}: it must be fx 0 cx 0 fy cy 0 0 1, row by row")
    if size is None:
        return matrix
    width, height = size
    x, y = float(matrix[0, 2]), float(matrix[1, 2])
    if not (0 <= x < width and 0 <= y < height):
        raise DataError(
            f"{where}: the principal point ({x:.6g}, {y:.6g}) lies outside the image of "
            f"{width}x{height}: are these the intrinsics of images of another size?"
        )
    low, high = (share * max(size) for share in FOCAL)
    focal = matrix[[0, 1], [0, 1]]
    if focal.min() < low or focal.max() > high or focal.max() > _MOST_UNEQUAL * focal.min():
        raise DataError(
            f"{where}: fx and fy are {focal[0]:.6g} and {focal[1]:.6g} px, in an image of "
            f"{width}x{height} they must be {low:g} to {high:g} and alike: give them in pixels"
        )
    return matrix


def require_depths(metres: Image, where: str) -> None:
    """Half of a depth image (m, 0 where missing) lies at distances that a camera measures."""
    median = float(np.median(metres[metres > 0])) if metres.any() else 0.0
    if not NEAREST <= median <= FARTHEST:
        raise DataError(
            f"{where}: half of the depth is nearer than {median:.3g} m, it must be {NEAREST:g} to "
            f"{FARTHEST:g} m: are these metres, or is depth_scale (mm per unit) wrong?"
        )


def require_near_depths(
    center_cam: Vector, metres: Image, matrix: CameraMatrix, where: str
) -> None:
    """A true pose lies at a distance like those that the depth image (m) has, and near the view."""
    present = metres[metres > 0]
    depth, low, high = float(center_cam[2]), float(present.min()), float(present.max())
    beside = float(np.abs(center_cam[:2]).max())
    far = not low / _BEYOND_DEPTH <= depth <= high * _BEYOND_DEPTH
    if far or beside * matrix[0, 0] > _BESIDE * max(metres.shape) * depth:
        raise DataError(
            f"{where} places the object at {depth:.4g} m and {beside:.4g} m beside the axis, but "
            f"the depth image reaches from {low:.4g} to {high:.4g} m: check the unit of the "
            "translations and depth_scale"
        )


Id = Annotated[WholeNumber, Le(2**31 - 1)]


def _flat(values: Any) -> Any:
    """Rows of a matrix as one list."""
    if isinstance(values, list) and values and all(isinstance(row, list) for row in values):
        return [number for row in values for number in row]
    return values


_Vector3 = Annotated[tuple[float, ...], Len(3, 3), _flat]
_Matrix3 = Annotated[tuple[float, ...], Len(9, 9), _flat]
_Matrix4 = Annotated[tuple[float, ...], Len(16, 16), _flat]


@dataclass(frozen=True)
class CameraEntry(Stored):
    """A frame's entry in scene_camera.json."""

    cam_K: _Matrix3  # noqa: N815
    depth_scale: Positive = 1.0


@dataclass(frozen=True)
class TruthEntry(Stored):
    """An annotated instance in scene_gt.json."""

    obj_id: Id
    cam_R_m2c: _Matrix3  # noqa: N815
    cam_t_m2c: _Vector3


@dataclass(frozen=True)
class InfoEntry(Stored):
    """What scene_gt_info.json says of an annotated instance; None where it says nothing."""

    visib_fract: Share | None = None


@dataclass(frozen=True)
class TargetRow(Stored):
    """A row of a list of targets; that of 2024 names frames alone."""

    scene_id: Id
    im_id: Id
    obj_id: Id | None = None
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


def record(**fields: Any) -> Any:
    """A `Stored` record of fields by their types, for files of which little is read."""
    return make_dataclass("record", fields.items(), bases=(Stored,), frozen=True)


def by_name(kind: Any) -> Any:
    """The type of an object of JSON whose values are all of one kind."""
    return GenericAlias(dict, (str, kind))


def several(kind: Any, count: int | None = None) -> Any:
    """The type of a list whose values are all of one kind; of so many values, if stated."""
    listed = GenericAlias(tuple, (kind, ...))
    return listed if count is None else Annotated[listed, Len(count, count)]


def whole_id(name: str) -> int:
    """An id that is the key of an object, as a number. Raises ValueError for another key."""
    if not (name.isascii() and name.isdecimal()) or str(int(name)) != name:
        raise ValueError(f"the key {name!r} is not an id: it must be a whole number from 0")
    return int(name)
