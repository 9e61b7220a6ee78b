"""Cutting of square patches from an image, resized to one resolution."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Num, UInt8

from hlp.compiled import compiled

# Bilinear sampling reads 2 x 2 pixels: patches that shrink by more than this would alias, and are
# cut from an image halved by area averaging.
MAX_SHRINK = 1.5
_ROWS_PER_REMAP = 16384  # cv2.remap is limited to 32767 rows


def sample_squares(
    image: Num[np.ndarray, "h w *c"],
    centers: Float[np.ndarray, "n 2"],
    sides: Float[np.ndarray, "n"],
    resolution: int,
    nearest: bool = False,
    border: float = 0.0,
) -> Num[np.ndarray, "n p p *c"]:
    """Cut squares of `sides` pixels around `centers` (x, y) and resize them to one resolution.

    Output pixel i samples the image at centre + ((i + ½)/p − ½)·side. `nearest` does
    not mix pixels, as depth requires; otherwise bilinear from an image halved until the shrink is
    at most 1.5. Outside the image the value is `border`.
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
        out[rows] = _remap(small, x, y, nearest, border)
    return out


def halvings(
    sides: Float[np.ndarray, "n"], resolution: int, shape: tuple[int, int]
) -> Int[np.ndarray, "n"]:
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


def bleed_color(
    rgb: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """Continue a view's colours two pixels beyond its silhouette.

    Bilinear sampling at the silhouette would otherwise mix in the black outside of it, and networks
    would learn that objects have dark outlines.
    """
    out = np.array(rgb)
    _continue_colors(out, mask)
    return out


@compiled()
def _continue_colors(rgb: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> None:
    """Set the pixels outside `mask` to the mean of the masked pixels of 5 × 5 about them, or 0."""
    height, width = mask.shape
    share = 1.0 / 25.0
    # Sums over 5 rows of number and colours, with two more columns on both sides: an image is
    # continued by its mirror image about the outermost pixels.
    sums = np.zeros((width + 4, 4), dtype=np.int32)
    bled = np.zeros_like(rgb)
    for y in range(height):
        _sum_rows(rgb, mask, y, sums)
        for x in range(width):
            known = np.int32(0)
            for column in range(x, x + 5):
                known += sums[column, 0]
            if known == 0 or mask[y, x]:
                continue
            weight = np.float32(known * share)
            for channel in range(3):
                total = np.int32(0)
                for column in range(x, x + 5):
                    total += sums[column, channel + 1]
                mean = np.float32(total * share) / weight
                bled[y, x, channel] = np.uint8(min(mean, np.float32(255.0)))
    for y in range(height):
        for x in range(width):
            if not mask[y, x]:
                rgb[y, x] = bled[y, x]


@compiled()
def _sum_rows(
    rgb: UInt8[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    y: int,
    sums: Int[np.ndarray, "w+4 4"],
) -> None:
    height, width = mask.shape
    sums[:] = 0
    for step in range(-2, 3):
        row = _mirrored(y + step, height)
        for x in range(width):
            if mask[row, x]:
                sums[x + 2, 0] += 1
                for channel in range(3):
                    sums[x + 2, channel + 1] += rgb[row, x, channel]
    for outside in (-2, -1, width, width + 1):
        inside = _mirrored(outside, width)
        for column in range(4):
            sums[outside + 2, column] = sums[inside + 2, column]


@compiled()
def _mirrored(index: int, length: int) -> int:
    """The index inside 0 … length - 1, mirrored about the first and last element."""
    if length == 1:
        return 0
    last = length - 1
    inside = abs(index) % (2 * last)
    return min(inside, 2 * last - inside)


def _sample_positions(
    centers: Float[np.ndarray, "n 2"], sides: Float[np.ndarray, "n"], resolution: int, factor: int
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
    border: float,
) -> Num[np.ndarray, "n p p *c"]:
    count, resolution = x.shape
    chunk = max(1, _ROWS_PER_REMAP // resolution)
    interpolation = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    parts = []
    for start in range(0, count, chunk):
        xs, ys = x[start : start + chunk], y[start : start + chunk]
        shape = (len(xs), resolution, resolution)
        map_x = np.broadcast_to(xs[:, None, :], shape).reshape(-1, resolution)
        map_y = np.broadcast_to(ys[:, :, None], shape).reshape(-1, resolution)
        flat = cv2.remap(
            image,
            np.ascontiguousarray(map_x),
            np.ascontiguousarray(map_y),
            interpolation,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(border,) * 4,
        )
        parts.append(flat.reshape(*shape, *image.shape[2:]))
    return np.concatenate(parts)
