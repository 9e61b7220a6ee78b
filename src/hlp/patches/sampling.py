"""Cutting of square patches from an image, resized to one resolution."""

from collections.abc import Sequence
from typing import TypeVar

import cv2
import numpy as np
from jaxtyping import Float, Num

from hlp.arrays import Mask, Positions, Rgb, Rows, Values

# Bilinear sampling reads 2 x 2 pixels: patches that shrink by more than this would alias, and are
# cut from an image halved by area averaging.
MAX_SHRINK = 1.5
Record = TypeVar("Record")
_ROWS_PER_REMAP = 16384  # cv2.remap is limited to 32767 rows


def join(parts: Sequence[Record]) -> Record:
    """One record of arrays with the rows of several."""
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*map(np.concatenate, columns))


def sample_squares(
    image: Num[np.ndarray, "h w *c"],
    centers: Positions,
    sides: Values,
    resolution: int,
    nearest: bool = False,
) -> Num[np.ndarray, "n p p *c"]:
    """Cut squares of `sides` pixels around `centers` (x, y) and resize them to one resolution.

    Output pixel i samples the image at centre + ((i + ½)/p − ½)·side. `nearest` does
    not mix pixels, as depth requires; otherwise bilinear from an image halved until the shrink is
    at most 1.5. Outside the image the value is 0.
    """
    out = np.empty((len(centers), resolution, resolution, *image.shape[2:]), dtype=image.dtype)
    levels = halvings(sides, resolution, (image.shape[0], image.shape[1]))
    if nearest:
        levels = np.zeros_like(levels)
    for level in np.unique(levels):
        rows = np.flatnonzero(levels == level)
        factor = 2**level
        small = area_shrink(image, factor)
        x, y = _sample_positions(centers[rows], sides[rows], resolution, factor)
        out[rows] = _remap(small, x, y, nearest)
    return out


def halvings(sides: Values, resolution: int, shape: tuple[int, int]) -> Rows:
    """How often an image is halved before squares of `sides` pixels are cut from it."""
    shrink = np.maximum(np.asarray(sides, dtype=np.float64) / resolution / MAX_SHRINK, 1.0)
    levels = np.ceil(np.log2(shrink)).astype(int)
    return np.asarray(np.minimum(levels, int(np.log2(min(shape)))))  # at least one pixel remains


def area_shrink(image: Num[np.ndarray, "h w *c"], factor: int) -> Num[np.ndarray, "h2 w2 *c"]:
    """The image reduced by a whole factor: each pixel is the mean of factor² pixels."""
    if factor == 1:
        return image
    height, width = image.shape[:2]
    # Cropped to a multiple of the factor, so that every small pixel averages exactly factor²
    # pixels and its centre is where `_sample_positions` expects it.
    even = image[: height // factor * factor, : width // factor * factor]
    size = (width // factor, height // factor)
    return np.asarray(cv2.resize(even, size, interpolation=cv2.INTER_AREA))


def bleed_color(rgb: Rgb, mask: Mask) -> Rgb:
    """Continue a view's colours two pixels beyond its silhouette.

    Bilinear sampling at the silhouette would otherwise mix in the black outside of it, and networks
    would learn that objects have dark outlines.
    """
    share = cv2.boxFilter(mask.astype(np.float32), -1, (5, 5))
    total = cv2.boxFilter((rgb * mask[..., None]).astype(np.float32), -1, (5, 5))
    mean = np.minimum(total / np.maximum(share, 1e-6)[..., None], 255.0)
    return np.where(mask[..., None], rgb, mean.astype(np.uint8))


def _sample_positions(
    centers: Positions, sides: Values, resolution: int, factor: int
) -> tuple[Float[np.ndarray, "n p"], Float[np.ndarray, "n p"]]:
    steps = (np.arange(resolution) + 0.5) / resolution - 0.5
    offsets = np.asarray(sides)[:, None] * steps
    x = (centers[:, :1] + offsets + 0.5) / factor - 0.5
    y = (centers[:, 1:] + offsets + 0.5) / factor - 0.5
    return x.astype(np.float32), y.astype(np.float32)


def _remap(
    image: Num[np.ndarray, "h w *c"],
    x: Float[np.ndarray, "n p"],
    y: Float[np.ndarray, "n p"],
    nearest: bool,
) -> Num[np.ndarray, "n p p *c"]:
    count, resolution = x.shape
    chunk = max(1, _ROWS_PER_REMAP // resolution)
    interpolation = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    parts = []
    for start in range(0, count, chunk):
        xs, ys = x[start : start + chunk], y[start : start + chunk]
        shape = (len(xs), resolution, resolution)
        places = np.broadcast_to(xs[:, None, :], shape), np.broadcast_to(ys[:, :, None], shape)
        x_of, y_of = (np.ascontiguousarray(each).reshape(-1, resolution) for each in places)
        flat = cv2.remap(image, x_of, y_of, interpolation, borderMode=cv2.BORDER_CONSTANT)
        parts.append(flat.reshape(*shape, *image.shape[2:]))
    return np.concatenate(parts)
