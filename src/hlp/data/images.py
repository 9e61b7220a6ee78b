"""Colour and depth images and camera files, read with checks; errors name the file."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hlp.errors import DataError, InputError, MissingDependencyError, MissingFileError
from hlp.files import NO_ARRAYS
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


_DEPTH_MODES = ("I;16", "I;16B", "I;16L", "I", "F")


def image_size(path: Path, most_megapixels: float) -> tuple[int, int]:
    """Width and height of a colour or grey image.

    Raises MissingFileError; DataError for a file that is no image, empty or larger than
    `most_megapixels`.
    """
    return _header(path, most_megapixels)[0]


def depth_image_size(path: Path, most_megapixels: float) -> tuple[int, int]:
    """The same for a depth image. Raises DataError if it does not have one channel of 16 bits."""
    size, mode = _header(path, most_megapixels)
    if mode not in _DEPTH_MODES:
        raise DataError(
            f"{path} has pixels of the kind {mode}: depth must be a 16-bit PNG of one channel"
        )
    return size


def require_same_size(rgb_path: Path, size: tuple[int, int], depth_size: tuple[int, int]) -> None:
    """Raise DataError unless colour and depth of a frame have the same size (width, height)."""
    if size != depth_size:
        raise DataError(
            f"{rgb_path} is {size[0]}x{size[1]} but its depth image is "
            f"{depth_size[0]}x{depth_size[1]}: register depth to colour first"
        )


def _header(path: Path, most_megapixels: float) -> tuple[tuple[int, int], str]:
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise MissingFileError(f"no image {path}")
    try:
        with Image.open(path) as image:
            size, mode = (int(image.size[0]), int(image.size[1])), str(image.mode)
    except PermissionError as error:
        raise DataError(f"{path} may not be read: give yourself the right to") from error
    except Image.DecompressionBombError as error:
        raise _too_large(path, most_megapixels) from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise DataError(f"{path} is truncated or no image: copy or download it again") from error
    if size[0] * size[1] > most_megapixels * 1e6:
        raise _too_large(path, most_megapixels, size)
    return size, mode


def _too_large(path: Path, most: float, size: tuple[int, int] | None = None) -> DataError:
    stated = "" if size is None else f" of {size[0]}x{size[1]}"
    return DataError(
        f"{path} is an image{stated} with more than {most:g} megapixels: make it smaller, or raise "
        "data.max_megapixels"
    )


DEPTH_EXTENSIONS = (".png", ".tif", ".tiff", ".exr", ".npy", *EXTENSIONS)
_NEAREST, _FARTHEST = 0.05, 20.0  # m: the median distance in an image of a depth camera
_DEPTH_CHANNELS = ("Z", "Y", "R", "V", "RGB", "RGBA")  # of an EXR file, the likeliest first


def read_raw_depth(path: Path) -> np.ndarray[Any, Any]:
    """The values of a depth image (h, w) as they are in the file: integers or floating point.

    Raises MissingFileError; DataError for a broken file, more than one channel, or 8 bits; and
    MissingDependencyError for an EXR file without the package OpenEXR.
    """
    if not path.is_file():
        raise MissingFileError(f"no depth image {path}")
    kind = path.suffix.lower()
    if kind == ".npy":
        raw = _read_npy(path)
    elif kind == ".exr":
        raw = _read_exr(path)
    else:
        raw = decode_unchanged(path)
    if raw.ndim == 3 and raw.shape[2] == 1:
        raw = raw[..., 0]
    if raw.ndim != 2 or raw.dtype.kind not in "uif" or raw.dtype.itemsize < 2 or raw.size == 0:
        raise DataError(
            f"{path} holds {raw.dtype} {raw.shape}: depth must have one channel of 16-bit numbers "
            "or more, as PNG, TIFF, EXR or NPY"
        )
    return raw


def depth_in_metres(
    raw: np.ndarray[Any, Any], millimetres: float, path: Path
) -> np.ndarray[Any, Any]:
    """Depth (h, w) in metres (float32), 0 where missing: 0, negative, NaN, or 65535 in 16 bits.

    `millimetres` is the length of one unit. Raises DataError if no pixel has depth, or if their
    median is no distance that a depth camera measures.
    """
    unit = np.float32(millimetres / MILLIMETRES_PER_METRE)
    with np.errstate(over="ignore"):
        metres = np.where(_present(raw), raw, 0).astype(np.float32) * unit
    if not metres.any():
        raise DataError(f"{path} has no depth at any pixel: check the sensor or leave it out")
    median = float(np.median(metres[metres > 0]))
    if not _NEAREST <= median <= _FARTHEST:
        raise DataError(
            f"{path}: half of the depth is nearer than {median:.3g} m at {millimetres:g} mm per "
            f"unit, which no depth camera measures: check depth_scale"
        )
    return np.asarray(metres)


def guess_unit(raw: np.ndarray[Any, Any], path: Path) -> tuple[float, str]:
    """Millimetres per unit of a depth image, and a sentence that says why.

    The values are taken for millimetres or metres, whichever makes their median a distance that a
    depth camera measures. Raises InputError if neither does.
    """
    present = raw[_present(raw)]
    if not len(present):
        raise DataError(f"{path} has no depth at any pixel: check the sensor or leave it out")
    median = float(np.median(present))
    for millimetres, unit in ((MILLIMETRES_PER_METRE, "metres"), (1.0, "millimetres")):
        whole = raw.dtype.kind != "f" and unit == "metres"  # nobody measures in whole metres
        if not whole and _NEAREST <= median * millimetres / MILLIMETRES_PER_METRE <= _FARTHEST:
            return millimetres, (
                f"depth is in {unit}: half of {path.name} is nearer than {median:.4g} "
                f"(depth_scale={millimetres:g} mm per unit; give another one if this is wrong)"
            )
    raise InputError(
        f"depth: half of {path} is nearer than {median:.4g}, a likely distance neither in "
        "millimetres nor in metres: give depth_scale, in millimetres per unit"
    )


def _present(raw: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    if raw.dtype.kind == "f":
        return np.asarray(np.isfinite(raw) & (raw > 0))
    missing = raw == SATURATED if raw.dtype.itemsize == 2 else False
    return np.asarray((raw > 0) & ~np.asarray(missing))


def _read_npy(path: Path) -> np.ndarray[Any, Any]:
    try:
        return np.asarray(np.load(path, allow_pickle=False))
    except NO_ARRAYS as error:
        raise DataError(f"{path} is truncated or no array: copy or save it again") from error


def _read_exr(path: Path) -> np.ndarray[Any, Any]:
    try:
        import OpenEXR
    except ImportError as error:
        raise MissingDependencyError(
            f"{path}: EXR needs the package OpenEXR: pip install 'hlp[exr]', or convert to TIFF"
        ) from error
    try:
        channels = OpenEXR.File(str(path)).channels()
        found = {name: np.asarray(each.pixels) for name, each in channels.items()}
    except (RuntimeError, ValueError, TypeError) as error:
        raise DataError(f"{path} is truncated or no EXR image: copy it again") from error
    name = next((each for each in _DEPTH_CHANNELS if each in found), None)
    if name is None and len(found) == 1:
        name = next(iter(found))
    if name is None:
        raise DataError(f"{path} has the channels {', '.join(found)}: depth is looked for in Z")
    values = found[name]
    return values[..., 0] if values.ndim == 3 else values
