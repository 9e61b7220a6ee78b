"""Checks of what a user gives to a detector; errors name the argument."""

import logging
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from hlp import schemas
from hlp.arrays import CameraMatrix, Image, Mask, Pose, Rgb
from hlp.errors import DataError, InputError
from hlp.records import Frame

T = TypeVar("T")
_logger = logging.getLogger(__name__)
_NEAREST, _FARTHEST = 0.05, 20.0
"""All of the depth (m) lies beyond the first, half of it nearer than the last: else another unit"""
_LEAST_SIDE = 8  # pixels


class RgbdFrame(Protocol):
    """An RGB-D image with its camera, as `Detector.detect` takes them: `hlp.CameraImage` is one.

    Examples:
        >>> [found.object for found in detector.tracker(["bear"], 1).update(image)]
        ['bear']
    """

    @property
    def rgb(self) -> Rgb:
        """Colour, red first."""

    @property
    def depth(self) -> Image:
        """Depth (m) along the optical axis, registered to the colour; 0 or NaN where missing."""

    @property
    def camera_matrix(self) -> CameraMatrix:
        """Intrinsics (px), with pixel centres at integers."""


def check_limits(max_instances: Any, min_score: Any) -> None:
    """Raise InputError unless at least one instance is asked for, with a probability."""
    whole = isinstance(max_instances, Integral) and not isinstance(max_instances, bool)
    if not whole or max_instances < 1:
        raise InputError(f"max_instances is {max_instances!r}: it must be a whole number from 1")
    number = isinstance(min_score, Real) and not isinstance(min_score, bool)
    if not number or not 0.0 <= min_score <= 1.0:
        raise InputError(f"min_score is {min_score!r}: it must be a probability, 0 to 1")


def checked_settings(given: object, kind: type[T]) -> T:
    """Settings of that class, its defaults for None. Raises InputError for anything else."""
    settings = kind() if given is None else given
    if not isinstance(settings, kind):
        raise InputError(f"settings is {settings!r}: it must be {kind.__name__}")
    return settings


def checked_names(given: Iterable[str], known: Iterable[str], folder: Path) -> list[str]:
    """Names of learnt objects, each once. Raises InputError for what is not a name of one."""
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise InputError(f"objects is {given!r}: give a list of names")
    names = list(given)
    unknown = [str(name) for name in names if not isinstance(name, str) or name not in {*known}]
    if unknown:
        learnt = ", ".join(known)
        raise InputError(f"objects: {', '.join(unknown)} not learnt; {folder} has {learnt}")
    return list(dict.fromkeys(map(str, names)))


def checked_path(given: object, name: str) -> Path:
    """The argument as a path. Raises InputError for what is none."""
    if not isinstance(given, str | PathLike) or "\0" in (path := str(fspath(given))):
        raise InputError(f"{name} is {given!r}: it must be a path")
    return Path(path)


def checked_meshes(given: object) -> dict[str, Path]:
    """The files of meshes by name. Raises InputError for another form."""
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise InputError(
            f"meshes is {str(given)[:60]!r}: it must map names to files, "
            "{'bracket': 'bracket.ply'}"
        )
    return {name: checked_path(path, f"meshes[{name!r}]") for name, path in given.items()}


def checked_backgrounds(given: object) -> tuple[Frame, ...]:
    """RGB-D frames as backgrounds. Raises InputError for anything else."""
    frames = tuple(given) if isinstance(given, Iterable) else (given,)
    if not all(isinstance(frame, Frame) for frame in frames):
        raise InputError("background_frames: they must be frames, as hlp.records.Frame")
    return frames


def _array(given: object, name: str) -> np.ndarray[Any, Any]:
    """The argument as an array with rows in sequence; what is masked counts as missing."""
    try:
        filled = np.ma.filled(given, 0) if np.ma.isMaskedArray(given) else given
        return np.asarray(filled, order="C")
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:  # of numpy and torch
        raise InputError(f"{name} is not an array: {error}") from error


def checked_mask(given: object, shape: tuple[int, ...]) -> Mask:
    """The argument as a mask (h, w). Raises InputError for another form, or if it is empty."""
    mask = _array(given, "mask")
    if mask.dtype != np.bool_ or mask.shape != shape:
        raise InputError(f"mask is {mask.dtype} {mask.shape}: it must be bool {shape}, as depth is")
    if not mask.any():
        raise InputError("mask covers no pixel: leave it out, or mark where the object may be")
    return mask


def checked_pose(given: object) -> Pose:
    """The argument as a rigid motion. Raises InputError for anything else."""
    pose = _array(given, "pose_cam_obj")
    if pose.dtype.kind not in "uif" or pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise InputError(f"pose_cam_obj must be 4 × 4 finite numbers, not {str(given)[:60]!r}")
    if not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise InputError(f"pose_cam_obj: its last row is {pose[3].tolist()}, it must be 0 0 0 1")
    try:
        schemas.exact_rotation(pose[:3, :3].astype(np.float64), "pose_cam_obj[:3, :3]")
    except DataError as error:
        raise InputError(str(error)) from None
    if (farthest := np.abs(pose[:3, 3].astype(np.float64)).max()) > _FARTHEST:
        raise InputError(
            f"pose_cam_obj is {farthest:.4g} m away: it must be in metres, is it in millimetres?"
        )
    return pose.astype(np.float64)


def checked_rgbd(given: RgbdFrame) -> Frame:
    """A frame of a sequence, as `checked_frame`. Raises InputError naming what is wrong."""
    for name in ("rgb", "depth", "camera_matrix"):
        if not hasattr(given, name):
            raise InputError(f"a frame must have rgb, depth and camera_matrix: {name} is not")
    return checked_frame(given.rgb, given.depth, given.camera_matrix)


def checked_frame(rgb: object, depth: object, camera_matrix: object) -> Frame:
    """The arguments of `detect` as a frame. Raises InputError naming what is wrong."""
    color = _array(rgb, "rgb")
    if color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8:
        raise InputError(f"rgb is {color.dtype} {color.shape}: it must be uint8 (h, w, 3)")
    distance = _array(depth, "depth")
    if distance.ndim != 2 or distance.dtype.kind != "f":
        raise InputError(
            f"depth is {distance.dtype} {distance.shape}: it must be floating point (h, w), in "
            "metres; for millimetres in uint16: depth / 1000"
        )
    if distance.shape != color.shape[:2]:
        raise InputError(f"depth is {distance.shape}, rgb {color.shape[:2]}: they must be alike")
    if min(distance.shape) < _LEAST_SIDE:
        raise InputError(f"rgb is {color.shape}: it must have {_LEAST_SIDE} pixels a side at least")
    with np.errstate(over="ignore"):
        distance = distance.astype(np.float32, copy=False)
    distance = np.where(np.isfinite(distance), distance, np.float32(0.0))
    if distance.min() < 0.0:
        raise InputError("depth has negative values: metres, 0 where missing")
    if (farthest := distance.max()) == 0.0:
        _logger.warning("depth is 0 or NaN everywhere: nothing can be found")
    elif farthest < _NEAREST:
        raise InputError(f"depth is nowhere more than {farthest:.3g} m: it must be in metres")
    if farthest > _FARTHEST:  # the median takes longer than tracking an object
        median = np.median(distance[distance > 0.0])
        if median > _FARTHEST:
            raise InputError(
                f"depth has a median of {median:.4g} m: it must be in metres, is it in mm?"
            )
    return Frame(0, 0, color, distance, _checked_camera(camera_matrix, distance.shape))


def _checked_camera(given: object, shape: tuple[int, ...]) -> CameraMatrix:
    values = _array(given, "camera_matrix")
    if values.dtype.kind not in "uif" or values.shape != (3, 3):
        raise InputError(f"camera_matrix must be 3 × 3 numbers, not {str(given)[:60]!r}")
    try:
        copied = values.astype(np.float64)
        return schemas.camera_matrix(copied, "camera_matrix", (shape[1], shape[0]))
    except DataError as error:
        raise InputError(str(error)) from None
