"""Composites of windows and backgrounds, as a camera would see them (paper, section 3.1).

The random numbers of an image form one record; a compiled kernel then computes its pixels in one
pass, which keeps the image in the processor's cache.
"""

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt8

from hlp.arrays import ColorPatches, DepthCodes, MaskPatches, Values
from hlp.kernels import compiled, compiled_ahead
from hlp.threads import ThreadTeam

NOISE_LENGTH = 1 << 20
"""Length of the table of standard normal values from which noise is read."""

_LEVELS = 2048  # of the tone curve's table
_NO_DEPTH = np.float32(1.0)  # depth where nothing was measured

COMPOSITE_DRAWS = np.dtype(
    [
        ("background_only", "?"),  # no object in the image
        ("top", "i4"),  # occluder's rectangle (px); empty if there is none
        ("bottom", "i4"),
        ("left", "i4"),
        ("right", "i4"),
        ("image", "i4", (4,)),  # the camera's image: first and end of its rows, then of its columns
        ("background", "i4"),  # index of the background, and of the one that the occluder shows
        ("occluder", "i4"),
        ("background_gain", "f4"),
        ("occluder_gain", "f4"),
        ("color_mix", "f4", (3, 3)),  # matrix applied to the object's colour
        ("exposure", "f4"),
        ("gamma", "f4"),
        ("contrast", "f4"),
        ("blurs", "i4"),
        ("color_noise", "f4"),
        ("background_offset", "f4"),  # added to its depth; depths are in units of the window, ±1
        ("background_plane", "f4", (3,)),  # without depth: offset, slopes down and right
        ("background_heights", "f4", (4, 4)),  # coarse grid added to that plane
        ("occluder_plane", "f4", (3,)),  # offset, slopes down and right
        ("depth_shift", "f4"),
        ("depth_noise", "f4"),
        ("holes", "f4", (16, 16)),  # no depth where this field exceeds hole_level
        ("hole_level", "f4"),
        ("noise_start", "i4"),  # index in the noise table
    ],
    align=True,
)
"""The random numbers of one image."""
CompositeDraws = Annotated[np.ndarray, COMPOSITE_DRAWS]
"""Those of n images, (n,)."""


class ObjectWindows(NamedTuple):
    """Windows of objects: colour, depth as coded by `depth_code`, and where the object is."""

    color: ColorPatches
    code: DepthCodes
    mask: MaskPatches


class BackgroundPool(NamedTuple):
    """Background images; depth is coded as in windows, 0 throughout for images without depth."""

    color: ColorPatches
    depth: DepthCodes


def compose_windows(
    windows: ObjectWindows,
    backgrounds: BackgroundPool,
    draws: CompositeDraws,
    noise: Float32[np.ndarray, "k"],
    with_depth: bool,
    threads: int,
) -> Float[np.ndarray, "n p p c"]:
    """Images in [-1, 1] of n windows: colour, and `with_depth` depth as the fourth channel.

    The result does not depend on the number of `threads`.
    """
    out = np.empty((*windows.mask.shape, 4 if with_depth else 3), dtype=np.float32)

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        some = ObjectWindows(*(array[part] for array in windows))
        _compose(some, backgrounds, draws[part], noise, out[part])

    ThreadTeam(threads).map_ranges(work, len(out))
    return out


@compiled_ahead()
def _compose(
    windows: ObjectWindows,
    backgrounds: BackgroundPool,
    draws: CompositeDraws,
    noise: Float32[np.ndarray, "k"],
    out: Float32[np.ndarray, "n p p c"],
) -> None:
    color, code, mask = windows
    size = mask.shape[1]
    image = np.empty((size, size, 3), dtype=np.float32)
    lines = np.empty((size, size, 3), dtype=np.float32)
    for i in range(len(mask)):
        draw = draws[i]
        pictures = backgrounds.color[draw["background"]], backgrounds.color[draw["occluder"]]
        _compose_color(color[i], mask[i], *pictures, draw, image)
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
            behind = backgrounds.depth[draw["background"]]
            _compose_depth(code[i], mask[i], behind, draw, noise, start, out[i])
        _cut_off(out[i], draw["image"])


@compiled()
def _cut_off(window: Float[np.ndarray, "p p c"], image: Int32[np.ndarray, "4"]) -> None:
    """Leave nothing of a window beyond the image's border: black and without depth."""
    size = window.shape[0]
    for y in range(size):
        for x in range(size):
            if not (image[0] <= y < image[1] and image[2] <= x < image[3]):
                window[y, x, :3] = -1.0
                window[y, x, 3:] = _NO_DEPTH


@compiled()
def _compose_color(
    color: UInt8[np.ndarray, "p p 3"],
    mask: Bool[np.ndarray, "p p"],
    background: UInt8[np.ndarray, "p p 3"],
    occluder: UInt8[np.ndarray, "p p 3"],
    draw: np.void,
    image: Float[np.ndarray, "p p 3"],
) -> None:
    """The object over the background, the occluder over both; 1 is white."""
    unit = np.float32(1.0 / 255.0)
    mix = draw["color_mix"]
    size = mask.shape[0]
    for y in range(size):
        covered = draw["top"] <= y < draw["bottom"]
        for x in range(size):
            if covered and draw["left"] <= x < draw["right"]:
                for c in range(3):
                    image[y, x, c] = occluder[y, x, c] * unit * draw["occluder_gain"]
            elif mask[y, x] and not draw["background_only"]:
                r, g, b = color[y, x, 0] * unit, color[y, x, 1] * unit, color[y, x, 2] * unit
                for c in range(3):
                    image[y, x, c] = mix[c, 0] * r + mix[c, 1] * g + mix[c, 2] * b
            else:
                for c in range(3):
                    image[y, x, c] = background[y, x, c] * unit * draw["background_gain"]


@compiled()
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


@compiled()
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


@compiled()
def _compose_depth(
    code: UInt8[np.ndarray, "p p"],
    mask: Bool[np.ndarray, "p p"],
    background: UInt8[np.ndarray, "p p"],
    draw: np.void,
    noise: Values,
    start: int,
    out: Float[np.ndarray, "p p 4"],
) -> None:
    """Depth of the composite in the fourth channel, with noise and holes."""
    size = mask.shape[0]
    measured = background.max() > 0
    middle = 0.5 * (size - 1)
    for y in range(size):
        covered = draw["top"] <= y < draw["bottom"]
        down = (y - middle) / (size - 1)
        for x in range(size):
            right = (x - middle) / (size - 1)
            if covered and draw["left"] <= x < draw["right"]:
                plane = draw["occluder_plane"]
                depth = plane[0] + plane[1] * down + plane[2] * right
            elif mask[y, x] and not draw["background_only"]:
                depth = (code[y, x] - 128.0) / 127.0
            elif measured:
                depth = (background[y, x] - 128.0) / 127.0 + draw["background_offset"]
            else:
                plane, offset = draw["background_plane"], draw["background_offset"]
                depth = plane[0] + plane[1] * down + plane[2] * right + offset
                depth += _smooth(draw["background_heights"], y, x, size)
            depth += draw["depth_shift"] + noise[start] * draw["depth_noise"]
            start += 1
            hole = _smooth(draw["holes"], y, x, size) > draw["hole_level"]
            out[y, x, 3] = _NO_DEPTH if hole else min(max(depth, -1.0), 1.0)


@compiled(inline="always")
def _smooth(grid: Float[np.ndarray, "k k"], y: int, x: int, size: int) -> float:
    """Value of a coarse grid at a pixel, interpolated bilinearly between cell centres."""
    cells = grid.shape[0]
    v = min(max((y + 0.5) * cells / size - 0.5, 0.0), cells - 1.0)
    u = min(max((x + 0.5) * cells / size - 0.5, 0.0), cells - 1.0)
    top, left = int(v), int(u)
    bottom, right = min(top + 1, cells - 1), min(left + 1, cells - 1)
    dv, du = v - top, u - left
    upper = grid[top, left] * (1.0 - du) + grid[top, right] * du
    lower = grid[bottom, left] * (1.0 - du) + grid[bottom, right] * du
    return float(upper * (1.0 - dv) + lower * dv)
