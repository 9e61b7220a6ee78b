"""Lens distortion undone, and depth images brought to the pixels of the colour image."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from hlp.data.camera_files import Camera
from hlp.errors import InputError

Maps = tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]
_SCALE_STEPS = 100  # a size stated by the file may be a hundredth off the image's in proportion


def check_size(camera: Camera, shape: tuple[int, ...], image: Path, key: str) -> None:
    """Raise InputError unless a camera's intrinsics can be those of an image (h, w)."""
    height, width = shape[:2]
    if camera.size is not None and camera.size != (width, height):
        scale = width / camera.size[0]
        hint = "take those of the stream that the images come from"
        if abs(scale - height / camera.size[1]) < 1.0 / _SCALE_STEPS:
            hint = (
                f"if {image.name} is the whole picture made smaller or larger, multiply fx, fy, "
                f"cx and cy by {scale:g}"
            )
        raise InputError(
            f"{key} are those of images of {camera.size[0]}x{camera.size[1]}, but {image} is "
            f"{width}x{height}: {hint}"
        )
    x, y = camera.matrix[0, 2], camera.matrix[1, 2]
    if not (0 <= x < width and 0 <= y < height):
        raise InputError(
            f"{key}: the principal point ({x:g}, {y:g}) lies outside {image} ({width}x{height}): "
            "they belong to images of another size"
        )


def undistorted(image: np.ndarray[Any, Any], camera: Camera, nearest: bool) -> np.ndarray[Any, Any]:
    """The image that a camera with the same matrix and no distortion would have made.

    Depth must be taken from the `nearest` pixel: a mean over an edge is a place where nothing is.
    What the camera did not see is 0.
    """
    if not camera.distortion:
        return image
    height, width = image.shape[:2]
    across, down = _undistortion(
        tuple(camera.matrix.ravel()), camera.distortion, camera.fisheye, width, height
    )
    how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return np.asarray(cv2.remap(image, across, down, how, borderValue=0))


def resampled_depth(
    depth: Float[np.ndarray, "a b"],
    camera: Camera,
    color_matrix: Float[np.ndarray, "3 3"],
    shape: tuple[int, int],
) -> Float[np.ndarray, "h w"]:
    """Depth at the pixels of a colour image (h, w), for two cameras that stand in one place.

    Each colour pixel takes the value of the nearest depth pixel on its viewing ray, 0 where the
    depth camera does not look.
    """
    height, width = shape
    x = _positions(width, color_matrix[0, 0], color_matrix[0, 2], camera.matrix[0])
    y = _positions(height, color_matrix[1, 1], color_matrix[1, 2], camera.matrix[1, [1, 0, 2]])
    columns, rows = np.rint(x).astype(int), np.rint(y).astype(int)
    seen = (rows >= 0)[:, None] & (rows < depth.shape[0])[:, None]
    seen = seen & (columns >= 0) & (columns < depth.shape[1])
    last = np.array(depth.shape) - 1
    taken = depth[np.clip(rows, 0, last[0])[:, None], np.clip(columns, 0, last[1])]
    return np.asarray(np.where(seen, taken, 0).astype(depth.dtype))


def resized_camera(matrix: Float[np.ndarray, "3 3"], scale: float, size: tuple[int, int]) -> Camera:
    """The camera of an image `scale` times as large as that of `matrix`; `size` (width, height)."""
    resized = matrix.copy()
    resized[:2] *= scale
    # The centre of the first pixel lies half a pixel from the border, whatever the pixel's size.
    resized[:2, 2] += (scale - 1.0) / 2.0
    return Camera(resized, size)


def _positions(
    count: int, focal: float, center: float, row: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "n"]:
    """Where the other camera sees the rays of a line of pixels."""
    return np.asarray((np.arange(count) - center) / focal * row[0] + row[2])


@lru_cache(maxsize=4)
def _undistortion(
    values: tuple[float, ...],
    distortion: tuple[float, ...],
    fisheye: bool,
    width: int,
    height: int,
) -> Maps:
    matrix, coefficients = np.array(values).reshape(3, 3), np.array(distortion)
    make = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
    across, down = make(matrix, coefficients, np.eye(3), matrix, (width, height), cv2.CV_32FC1)
    return across, down
