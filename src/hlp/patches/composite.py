"""Composites of windows on backgrounds, as a camera would see them (paper, section 3.1).

What is drawn at random is a record of numbers an image; the work on pixels is one compiled pass
that stays in the processor's cache.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numba import njit

NOISE_LENGTH = 1 << 20
"""Length of the table of standard normal values that noise is read from."""

_LEVELS = 2048  # of the tone curve's table: a camera has 256
_FAR = np.float32(1.0)  # depth where nothing was measured

DRAWS = np.dtype(
    [
        ("alone", "?"),  # background without object
        ("top", "i4"),  # px of the occluder's rectangle; empty where there is none
        ("bottom", "i4"),
        ("left", "i4"),
        ("right", "i4"),
        ("behind", "i4"),  # row of the background, and of what the occluder shows
        ("before", "i4"),
        ("behind_gain", "f4"),
        ("before_gain", "f4"),
        ("surface", "f4", (3, 3)),  # mixes the object's own colour
        ("exposure", "f4"),
        ("gamma", "f4"),
        ("contrast", "f4"),
        ("blurs", "i4"),
        ("color_noise", "f4"),
        ("away", "f4"),  # how far the background lies behind; depths are those of windows, ±1
        ("far", "f4", (3,)),  # plane of a background without depth: offset, slopes down and right
        ("relief", "f4", (4, 4)),  # added to it, smoothly
        ("near", "f4", (3,)),  # plane of the occluder
        ("depth_shift", "f4"),
        ("depth_noise", "f4"),
        ("holes", "f4", (16, 16)),  # no depth where this smooth field exceeds the level
        ("hole_level", "f4"),
        ("noise_start", "i4"),  # where in the table this image's noise begins
    ]
)
"""What is drawn for one image."""


def compose_windows(
    color: UInt8[np.ndarray, "n p p 3"],
    code: UInt8[np.ndarray, "n p p"],
    mask: Bool[np.ndarray, "n p p"],
    background_color: UInt8[np.ndarray, "b p p 3"],
    background_code: UInt8[np.ndarray, "b p p"],
    draws: np.ndarray,
    noise: Float[np.ndarray, "t"],
    with_depth: bool,
    threads: int,
) -> Float[np.ndarray, "n p p c"]:
    """Images in [-1, 1] of n windows: colour, and `with_depth` depth as the fourth channel.

    `draws` (n,) of type DRAWS; a background's code is 0 throughout where it has no depth. The
    number of threads changes nothing but the time.
    """
    out = np.empty((*mask.shape, 4 if with_depth else 3), dtype=np.float32)
    bounds = np.linspace(0, len(mask), threads + 1).astype(int)

    def work(part: tuple[int, int]) -> None:
        _compose(*part, color, code, mask, background_color, background_code, draws, noise, out)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, pairwise(bounds)))
    return out


@njit(nogil=True, cache=True)
def _compose(
    first: int,
    last: int,
    color: UInt8[np.ndarray, "n p p 3"],
    code: UInt8[np.ndarray, "n p p"],
    mask: Bool[np.ndarray, "n p p"],
    background_color: UInt8[np.ndarray, "b p p 3"],
    background_code: UInt8[np.ndarray, "b p p"],
    draws: np.ndarray,
    noise: Float[np.ndarray, "t"],
    out: Float[np.ndarray, "n p p c"],
) -> None:
    size = mask.shape[1]
    image = np.empty((size, size, 3), dtype=np.float32)
    lines = np.empty((size, size, 3), dtype=np.float32)
    for i in range(first, last):
        draw = draws[i]
        behind, before = background_color[draw["behind"]], background_color[draw["before"]]
        _lay(color[i], mask[i], behind, before, draw, image)
        _expose(image, draw)
        for _ in range(draw["blurs"]):
            _blur(image, lines)
        start = draw["noise_start"]
        for y in range(size):
            for x in range(size):
                for c in range(3):
                    value = image[y, x, c] + noise[start] * draw["color_noise"]
                    out[i, y, x, c] = 2.0 * min(max(value, 0.0), 1.0) - 1.0
                    start += 1
        if out.shape[3] == 4:
            _lay_depth(
                code[i], mask[i], background_code[draw["behind"]], draw, noise, start, out[i]
            )


@njit(nogil=True, cache=True)
def _lay(
    color: UInt8[np.ndarray, "p p 3"],
    mask: Bool[np.ndarray, "p p"],
    behind: UInt8[np.ndarray, "p p 3"],
    before: UInt8[np.ndarray, "p p 3"],
    draw: np.void,
    image: Float[np.ndarray, "p p 3"],
) -> None:
    """Object on background, occluder on both; 1 is white."""
    unit = np.float32(1.0 / 255.0)
    mix = draw["surface"]
    size = mask.shape[0]
    for y in range(size):
        covered = draw["top"] <= y < draw["bottom"]
        for x in range(size):
            if covered and draw["left"] <= x < draw["right"]:
                for c in range(3):
                    image[y, x, c] = before[y, x, c] * unit * draw["before_gain"]
            elif mask[y, x] and not draw["alone"]:
                r, g, b = color[y, x, 0] * unit, color[y, x, 1] * unit, color[y, x, 2] * unit
                for c in range(3):
                    image[y, x, c] = mix[c, 0] * r + mix[c, 1] * g + mix[c, 2] * b
            else:
                for c in range(3):
                    image[y, x, c] = behind[y, x, c] * unit * draw["behind_gain"]


@njit(nogil=True, cache=True)
def _expose(image: Float[np.ndarray, "p p 3"], draw: np.void) -> None:
    """Exposure, clipping and gamma as one table, then contrast about the mean."""
    curve = (np.arange(_LEVELS + 1) / _LEVELS) ** draw["gamma"]
    table = curve.astype(np.float32)
    scale = draw["exposure"] * np.float32(_LEVELS)
    flat = image.reshape(-1)
    total = 0.0
    for k in range(flat.size):
        level = min(max(flat[k] * scale, np.float32(0.0)), np.float32(_LEVELS))
        flat[k] = table[int(level + np.float32(0.5))]
        total += flat[k]
    shift = np.float32(total / flat.size) * (np.float32(1.0) - draw["contrast"])
    for k in range(flat.size):
        flat[k] = flat[k] * draw["contrast"] + shift


@njit(nogil=True, cache=True)
def _blur(image: Float[np.ndarray, "p p 3"], lines: Float[np.ndarray, "p p 3"]) -> None:
    """Binomial 3 × 3, the border repeated."""
    size = image.shape[0]
    quarter, half = np.float32(0.25), np.float32(0.5)
    for y in range(size):
        for x in range(size):
            left, right = max(x - 1, 0), min(x + 1, size - 1)
            for c in range(3):
                ends = image[y, left, c] + image[y, right, c]
                lines[y, x, c] = half * image[y, x, c] + quarter * ends
    for y in range(size):
        above, below = max(y - 1, 0), min(y + 1, size - 1)
        for x in range(size):
            for c in range(3):
                ends = lines[above, x, c] + lines[below, x, c]
                image[y, x, c] = half * lines[y, x, c] + quarter * ends


@njit(nogil=True, cache=True)
def _lay_depth(
    code: UInt8[np.ndarray, "p p"],
    mask: Bool[np.ndarray, "p p"],
    behind: UInt8[np.ndarray, "p p"],
    draw: np.void,
    noise: Float[np.ndarray, "t"],
    start: int,
    out: Float[np.ndarray, "p p 4"],
) -> None:
    """Depth of the composite in the fourth channel, with noise and holes."""
    size = mask.shape[0]
    measured = behind.max() > 0
    middle = 0.5 * (size - 1)
    for y in range(size):
        covered = draw["top"] <= y < draw["bottom"]
        down = (y - middle) / (size - 1)
        for x in range(size):
            right = (x - middle) / (size - 1)
            if covered and draw["left"] <= x < draw["right"]:
                depth = draw["near"][0] + draw["near"][1] * down + draw["near"][2] * right
            elif mask[y, x] and not draw["alone"]:
                depth = (code[y, x] - 128.0) / 127.0
            elif measured:
                depth = (behind[y, x] - 128.0) / 127.0 + draw["away"]
            else:
                depth = (
                    draw["far"][0] + draw["far"][1] * down + draw["far"][2] * right + draw["away"]
                )
                depth += _smooth(draw["relief"], y, x, size)
            depth += draw["depth_shift"] + noise[start] * draw["depth_noise"]
            start += 1
            hole = _smooth(draw["holes"], y, x, size) > draw["hole_level"]
            out[y, x, 3] = _FAR if hole else min(max(depth, -1.0), 1.0)


@njit(nogil=True, cache=True, inline="always")
def _smooth(grid: Float[np.ndarray, "k k"], y: int, x: int, size: int) -> float:
    """A coarse grid at a pixel's centre, bilinear between the cells' centres."""
    cells = grid.shape[0]
    v = min(max((y + 0.5) * cells / size - 0.5, 0.0), cells - 1.0)
    u = min(max((x + 0.5) * cells / size - 0.5, 0.0), cells - 1.0)
    top, left = int(v), int(u)
    bottom, right = min(top + 1, cells - 1), min(left + 1, cells - 1)
    dv, du = v - top, u - left
    upper = grid[top, left] * (1.0 - du) + grid[top, right] * du
    lower = grid[bottom, left] * (1.0 - du) + grid[bottom, right] * du
    return float(upper * (1.0 - dv) + lower * dv)
