"""Colour and depth images, read with checks; errors name the file. Photographs as backgrounds."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import ColorPatches, Mask, Rgb
from hlp.errors import DataError, InputError, MissingDependencyError, MissingFileError
from hlp.files import NO_ARRAYS
from hlp.records import MILLIMETRES_PER_METRE
from hlp.schemas import FARTHEST, NEAREST

EXTENSIONS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
DEPTH_EXTENSIONS = (".png", ".tif", ".tiff", ".exr", ".npy", *EXTENSIONS)
_ABSENT = "no image {}: is the data set complete?"
_SATURATED = 65535  # 7-Scenes and others write this for missing depth
_PNG_16_BIT_GREY = b"\x10\x00"  # of a PNG's header: depth and kind of its pixels
_DEPTH_MODES = ("I;16", "I;16B", "I;16L", "I", "F")  # Pillow's names
_DEPTH_CHANNELS = ("Z", "Y", "R", "V", "RGB", "RGBA")  # of an EXR file, the likeliest first


def find_image(folder: Path, stem: str) -> Path:
    """The image `stem` in a folder, whatever its extension; a PNG's path if there is none."""
    paths = [folder / f"{stem}{extension}" for extension in EXTENSIONS]
    return next((path for path in paths if path.is_file()), paths[0])


def read_pixels(path: Path) -> np.ndarray[Any, Any]:
    """An image as it is in the file.

    Raises MissingFileError, and DataError if it is not an image or cannot be read.
    """
    return _decoded(_content(path), path, cv2.IMREAD_UNCHANGED)


def _decoded(content: bytes, path: Path, flags: int) -> np.ndarray[Any, Any]:
    encoded = np.frombuffer(content, np.uint8)
    try:
        image = cv2.imdecode(encoded, flags) if len(encoded) else None
    except cv2.error as error:  # its header states more pixels than `hlp` lets OpenCV make
        raise DataError(f"{path} is too large, or no image: {error.err}") from error
    if image is None:
        raise DataError(f"{path} is truncated or no image: copy or download it again")
    return np.asarray(image)


def read_rgb(path: Path) -> Rgb:
    """Colour image as RGB; grey becomes three equal channels, EXIF rotation is ignored as in depth.

    Raises MissingFileError, and DataError if the file is truncated or no image, or looks like a
    depth image: a PNG of one channel of 16 bits.
    """
    content = _content(path)
    if path.suffix.lower() == ".png" and content[24:26] == _PNG_16_BIT_GREY:
        raise DataError(f"{path} has one channel of 16 bits: is it a depth image?")
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return np.ascontiguousarray(_decoded(content, path, flags)[..., ::-1])


def read_raw_depth(path: Path) -> np.ndarray[Any, Any]:
    """The values of a depth image (h, w) as in the file: integers or floating point.

    Raises MissingFileError; DataError for a broken file, more than one channel, or 8 bits; and
    MissingDependencyError for an EXR file without the package OpenEXR.
    """
    kinds = {".npy": _read_npy, ".exr": _read_exr, ".dpt": _read_dpt}
    raw = kinds.get(path.suffix.lower(), read_pixels)(path)
    if raw.ndim == 3 and raw.shape[2] == 1:
        raw = raw[..., 0]
    if raw.ndim != 2 or raw.dtype.kind not in "uif" or raw.dtype.itemsize < 2 or raw.size == 0:
        raise DataError(
            f"{path} holds {raw.dtype} {raw.shape}: depth must have one channel of 16-bit numbers "
            "or more, as PNG, TIFF, EXR, NPY or DPT"
        )
    return raw


def depth_metres(
    raw: np.ndarray[Any, Any], millimetres: float, path: Path
) -> Float[np.ndarray, "h w"]:
    """Depth (h, w) in metres (float32), 0 where missing: 0, negative, NaN, or 65535 in 16 bits.

    `millimetres` is the length of one unit (BOP's `depth_scale`). Raises DataError if no pixel has
    depth.
    """
    present = _present(raw, path)
    with np.errstate(over="ignore"):  # of a unit that is none: the depths say so
        unit = np.float32(millimetres / MILLIMETRES_PER_METRE)
        metres = np.asarray(np.where(present, raw, 0).astype(np.float32) * unit)
    return np.nan_to_num(metres, copy=False, posinf=0.0) if raw.dtype.kind == "f" else metres


def guess_unit(raw: np.ndarray[Any, Any], path: Path) -> tuple[float, str]:
    """Millimetres per unit of a depth image, and a sentence that says why.

    The values are taken for millimetres or metres, whichever makes their median a distance that a
    depth camera measures. Raises InputError if neither does.
    """
    median = float(np.median(raw[_present(raw, path)]))
    for millimetres, unit in ((MILLIMETRES_PER_METRE, "metres"), (1.0, "millimetres")):
        whole = raw.dtype.kind != "f" and unit == "metres"  # nobody measures in whole metres
        if not whole and NEAREST <= median * millimetres / MILLIMETRES_PER_METRE <= FARTHEST:
            return millimetres, (
                f"depth is in {unit}: half of {path.name} is nearer than {median:.4g} "
                f"(depth_scale={millimetres:g} mm per unit; give another one if this is wrong)"
            )
    raise InputError(
        f"depth: half of {path} is nearer than {median:.4g}, a likely distance neither in "
        "millimetres nor in metres: give depth_scale, in millimetres per unit"
    )


def image_size(path: Path, most_megapixels: float, depth: bool = False) -> tuple[int, int]:
    """Width and height of an image, from its header; of a .dpt file, it must also be whole.

    Raises MissingFileError; DataError for a file that is not an image, empty or larger than
    `most_megapixels`, and for a `depth` image without one channel of 16 bits.
    """
    from PIL import Image, UnidentifiedImageError

    too_large = (
        f"with more than {most_megapixels:g} megapixels: make it smaller, or raise "
        "data.max_megapixels"
    )
    if not path.is_file():
        raise MissingFileError(_ABSENT.format(path))
    if path.suffix == ".dpt":
        rows, columns = _read_dpt(path).shape
        return columns, rows
    try:
        with Image.open(path) as image:
            width, height, mode = image.width, image.height, image.mode
    except PermissionError as error:
        raise DataError(f"{path} may not be read: give yourself the right to") from error
    except Image.DecompressionBombError as error:
        raise DataError(f"{path} is an image {too_large}") from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise DataError(f"{path} is truncated or no image: copy or download it again") from error
    if width * height > most_megapixels * 1e6:
        raise DataError(f"{path} is an image of {width}x{height} {too_large}")
    if depth and mode not in _DEPTH_MODES:
        raise DataError(
            f"{path} has pixels of the kind {mode}: depth must be a 16-bit PNG of one channel"
        )
    return width, height


def require_same_size(rgb: Path, size: tuple[int, ...], depth_size: tuple[int, ...]) -> None:
    """Raise DataError unless colour and depth of a frame have the same size (width, height)."""
    if size != depth_size:
        raise DataError(
            f"{rgb} is {size[0]}x{size[1]} but its depth image is {depth_size[0]}x{depth_size[1]}: "
            "register depth to colour first"
        )


def _content(path: Path) -> bytes:
    """All of a file. Raises MissingFileError, and DataError where the system cannot read it."""
    try:
        if path.is_file():
            return path.read_bytes()
    except OSError as error:  # no right to, a name that is too long, a disk that fails
        raise DataError(f"{path} cannot be read: {error.strerror}") from error
    raise MissingFileError(_ABSENT.format(path))


def _present(raw: np.ndarray[Any, Any], path: Path) -> Mask:
    """Where there is depth. Raises DataError if it is nowhere."""
    if raw.dtype.kind == "f":
        present = np.isfinite(raw) & (raw > 0)
    else:
        present = (raw > 0) & ((raw != _SATURATED) | (raw.dtype.itemsize != 2))
    if not present.any():
        raise DataError(f"{path} has no depth at any pixel: check the sensor or leave it out")
    return np.asarray(present)


def _read_npy(path: Path) -> np.ndarray[Any, Any]:
    content = BytesIO(_content(path))
    try:
        return np.asarray(np.load(content, allow_pickle=False))
    except NO_ARRAYS as error:
        raise DataError(f"{path} is truncated or no array: copy or save it again") from error


def _read_dpt(path: Path) -> np.ndarray[Any, Any]:
    """LINEMOD's depth (mm): rows, columns (int32), then the values (uint16), little-endian."""
    content = _content(path)
    rows, columns = np.frombuffer(content[:8].ljust(8, b"\0"), "<i4").tolist()
    if rows < 1 or columns < 1 or len(content) != 8 + 2 * rows * columns:
        raise DataError(f"{path} is truncated or no .dpt file: copy or download it again")
    return np.frombuffer(content, "<u2", offset=8).reshape(rows, columns)


def _read_exr(path: Path) -> np.ndarray[Any, Any]:
    try:
        import OpenEXR
    except ImportError as error:
        raise MissingDependencyError(
            f"{path}: EXR needs the package OpenEXR: pip install 'hlp[exr]', or convert to TIFF"
        ) from error
    _content(path)  # its library's errors do not say what is wrong with a file
    try:
        channels = OpenEXR.File(str(path)).channels()
        found = {name: np.asarray(channel.pixels) for name, channel in channels.items()}
    except (RuntimeError, ValueError, TypeError) as error:
        raise DataError(f"{path} is truncated or no EXR image: copy it again") from error
    likely = [name for name in _DEPTH_CHANNELS if name in found]
    if not likely and len(found) != 1:
        raise DataError(f"{path} has the channels {', '.join(found)}: depth is looked for in Z")
    values = found[likely[0]] if likely else next(iter(found.values()))
    return values[..., 0] if values.ndim == 3 else values


_MOST, _LONG_SIDE = 400, 400  # photographs that are cropped, and their size (px)


def list_photographs(folder: Path) -> tuple[Path, ...]:
    """All images below a folder, sorted; of a VOC data set only `JPEGImages`, not the masks.

    Raises FileNotFoundError if there is no such folder or no image in it.
    """
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in EXTENSIONS)
    voc = [path for path in found if path.parent.name == "JPEGImages"]
    if not found:
        raise MissingFileError(f"no photograph (jpg, png) in {folder}: check data.photographs")
    return tuple(voc or found)


def random_crops(
    images: Sequence[Rgb], count: int, size: int, rng: np.random.Generator
) -> ColorPatches:
    """Random square crops of random images, mirrored half of the time, resized to `size` pixels.

    The crop's side is uniform between `size` / 2 and the image's short side.
    """
    crops = np.empty((count, size, size, 3), np.uint8)
    for crop in crops:
        image = images[int(rng.integers(len(images)))]
        short = min(image.shape[:2])
        side = int(rng.integers(min(max(size // 2, 1), short), short + 1))
        top = int(rng.integers(image.shape[0] - side + 1))
        left = int(rng.integers(image.shape[1] - side + 1))
        patch = image[top : top + side, left : left + side]
        if rng.random() < 0.5:
            patch = patch[:, ::-1]
        # Bilinear resizing aliases when it shrinks; area resizing is blocky when it enlarges.
        method = cv2.INTER_AREA if side > size else cv2.INTER_LINEAR
        crop[:] = cv2.resize(np.ascontiguousarray(patch), (size, size), interpolation=method)
    return crops


def _shrink(image: Rgb) -> Rgb:
    factor = _LONG_SIDE / max(image.shape[:2])
    if factor >= 1:
        return image
    shape = [max(1, round(side * factor)) for side in image.shape[1::-1]]
    return np.asarray(cv2.resize(image, shape, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def photograph_crops(folder: Path, count: int, size: int, rng: np.random.Generator) -> ColorPatches:
    """Random square crops of the photographs in a folder, of which at most 400 are decoded.

    Raises DataError naming a file that is broken.
    """
    paths = list_photographs(folder)
    chosen = np.linspace(0, len(paths) - 1, min(_MOST, len(paths))).round().astype(int)
    return random_crops([_shrink(read_rgb(paths[i])) for i in chosen], count, size, rng)
