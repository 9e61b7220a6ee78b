"""Checks of what a user gives to a detector; errors name the argument."""

import numpy as np
from jaxtyping import Bool, Float

from hlp.errors import InputError
from hlp.records import Frame

_FARTHEST = 20.0  # m: a larger median depth means another unit


def check_limits(max_instances: int, min_score: float) -> None:
    """Raise InputError unless at least one instance is asked for, with a probability."""
    if max_instances < 1:
        raise InputError(f"max_instances is {max_instances}: it must be at least 1")
    if not 0.0 <= min_score <= 1.0:
        raise InputError(f"min_score is {min_score}: it must be a probability, 0 to 1")


def checked_mask(given: object, shape: tuple[int, ...]) -> Bool[np.ndarray, "h w"]:
    """The argument as a mask (h, w). Raises InputError for another form, or if it is empty."""
    mask = np.asarray(given)
    if mask.dtype != np.bool_ or mask.shape != shape:
        raise InputError(f"mask is {mask.dtype} {mask.shape}: it must be bool {shape}, as depth is")
    if not mask.any():
        raise InputError("mask covers no pixel: leave it out, or mark where the object may be")
    return mask


def checked_frame(rgb: object, depth: object, camera_matrix: object) -> Frame:
    """The arguments of `detect` as a frame. Raises InputError naming what is wrong."""
    color = np.asarray(rgb)
    if color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8:
        raise InputError(f"rgb is {color.dtype} {color.shape}: it must be uint8 (h, w, 3)")
    distance = np.asarray(depth)
    if distance.ndim != 2 or distance.dtype.kind != "f":
        raise InputError(
            f"depth is {distance.dtype} {distance.shape}: it must be floating point (h, w), in "
            "metres; for millimetres in uint16: depth / 1000"
        )
    if distance.shape != color.shape[:2]:
        raise InputError(f"depth is {distance.shape}, rgb {color.shape[:2]}: they must be alike")
    distance = np.where(np.isfinite(distance), distance, 0.0).astype(np.float32)
    if distance.min(initial=0.0) < 0.0:
        raise InputError("depth has negative values: metres, 0 where missing")
    if distance.max(initial=0.0) > _FARTHEST:  # the median takes longer than tracking an object
        median = np.median(distance[distance > 0.0])
        if median > _FARTHEST:
            raise InputError(
                f"depth has a median of {median:.4g} m: it must be in metres, is it in mm?"
            )
    return Frame(0, 0, color, distance, _checked_camera(camera_matrix, distance.shape))


def _checked_camera(given: object, shape: tuple[int, ...]) -> Float[np.ndarray, "3 3"]:
    try:
        camera = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"camera_matrix must be 3 × 3 numbers, not {given!r}") from error
    if camera.shape != (3, 3) or not np.isfinite(camera).all():
        raise InputError(f"camera_matrix must be 3 × 3 finite numbers, not {given!r}")
    if not np.array_equal(camera[[1, 2, 2, 2], [0, 0, 1, 2]], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"camera_matrix is {camera.tolist()}: its rows must be fx 0 cx, 0 fy cy, 0 0 1"
        )
    height, width = shape
    if camera[0, 0] <= 0 or camera[1, 1] <= 0:
        raise InputError("camera_matrix: both focal lengths must be positive")
    if not (0 <= camera[0, 2] < width and 0 <= camera[1, 2] < height):
        raise InputError(
            f"camera_matrix: the principal point ({camera[0, 2]:g}, {camera[1, 2]:g}) lies outside "
            f"the image ({width} × {height}): it belongs to images of another size"
        )
    return camera
