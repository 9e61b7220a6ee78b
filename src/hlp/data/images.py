"""Colour and depth images and camera files, read with checks; errors name the file."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hlp.errors import DataError, MissingFileError
from hlp.records import MILLIMETRES_PER_METRE

SATURATED = 65535
"""7-Scenes and others write this for missing depth."""
_PNG_16_BIT_GREY = b"\x10\x00"  # of a PNG's header: depth and kind of its pixels
EXTENSIONS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


def _decode(path: Path, flags: int) -> np.ndarray[Any, Any]:
    if not path.is_file():
        raise MissingFileError(f"no image {path}")
    encoded = np.frombuffer(path.read_bytes(), np.uint8)
    try:
        image = cv2.imdecode(encoded, flags) if len(encoded) else None
    except cv2.error as error:  # its header states a size that OpenCV refuses
        raise DataError(f"{path} is too large, or no image: {error.err}") from error
    if image is None:
        raise DataError(f"{path} is truncated or no image: copy or download it again")
    return np.asarray(image)


def decode_unchanged(path: Path) -> np.ndarray[Any, Any]:
    """An image as it is in the file. Raises FileNotFoundError, ValueError if it is no image."""
    return _decode(path, cv2.IMREAD_UNCHANGED)


def read_rgb(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Colour image as RGB; grey becomes three equal channels, EXIF rotation is ignored as in depth.

    Raises FileNotFoundError, and ValueError if the file is truncated or no image, or looks like a
    depth image: a PNG of one channel of 16 bits.
    """
    if path.is_file() and path.suffix.lower() == ".png":
        with path.open("rb") as stream:
            if stream.read(26)[24:] == _PNG_16_BIT_GREY:
                raise DataError(f"{path} has one channel of 16 bits: is it a depth image?")
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return np.ascontiguousarray(_decode(path, flags)[..., ::-1])


def read_depth(path: Path, millimetres: float) -> Float[np.ndarray, "h w"]:
    """16-bit depth PNG in metres (float32), 0 where missing (0 or 65535 in the file).

    `millimetres` is the length of one unit of the file (BOP's `depth_scale`). Raises
    FileNotFoundError; ValueError if the file is broken, not 16-bit, or has no depth at all.
    """
    raw = decode_unchanged(path)
    if raw.dtype != np.uint16 or raw.ndim != 2:
        raise DataError(
            f"{path} holds {raw.dtype} {raw.shape}: depth must be a 16-bit PNG of one channel"
        )
    return depth_metres(raw, millimetres, path)


def depth_metres(
    raw: np.ndarray[Any, Any], millimetres: float, path: Path
) -> Float[np.ndarray, "h w"]:
    """Raw 16-bit depth in metres (float32). Raises ValueError if no pixel has depth."""
    with np.errstate(over="ignore"):  # of a depth_scale that is none: the depths say so
        unit = np.float32(millimetres / MILLIMETRES_PER_METRE)
        metres = np.where(raw == SATURATED, 0, raw).astype(np.float32) * unit
    if not metres.any():
        raise DataError(f"{path} has no depth at any pixel: check the sensor or leave it out")
    return np.asarray(metres)


def same_size(rgb_path: Path, rgb: np.ndarray[Any, Any], depth: np.ndarray[Any, Any]) -> None:
    """Raise ValueError unless colour and depth of a frame have the same size."""
    if rgb.shape[:2] != depth.shape:
        raise DataError(
            f"{rgb_path} is {rgb.shape[1]}x{rgb.shape[0]} but its depth image is "
            f"{depth.shape[1]}x{depth.shape[0]}: register depth to colour first"
        )


def find_image(folder: Path, stem: str) -> Path:
    """The image `stem` in a folder, whatever its extension. Raises FileNotFoundError."""
    for extension in EXTENSIONS:
        if (path := folder / f"{stem}{extension}").is_file():
            return path
    raise MissingFileError(f"no image {folder / stem}.png (nor .jpg): is the data set complete?")


def camera_matrix(values: Any, path: Path) -> Float[np.ndarray, "3 3"]:
    """Check nine numbers of an intrinsic matrix K (row-major). Raises ValueError naming `path`."""
    try:
        matrix = np.asarray(values, dtype=np.float64).reshape(3, 3)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{path}: cam_K must hold 9 numbers, not {values!r}") from error
    if not np.isfinite(matrix).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise DataError(f"{path}: cam_K {values!r} needs finite numbers and positive focal lengths")
    return matrix
