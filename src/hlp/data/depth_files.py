"""Depth images as PNG, TIFF, EXR or NPY, and the unit of their values."""

from pathlib import Path
from typing import Any

import numpy as np

from hlp.data.images import EXTENSIONS, SATURATED, decode_unchanged
from hlp.errors import DataError, InputError, MissingDependencyError, MissingFileError
from hlp.files import NO_ARRAYS
from hlp.records import MILLIMETRES_PER_METRE

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
