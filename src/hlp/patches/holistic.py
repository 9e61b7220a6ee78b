"""Holistic patches: windows of an object's metric size (paper, section 3.1, Eq. 1)."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Unit
from jaxtyping import Float, Float32

from hlp.arrays import (
    CameraMatrix,
    ColorPatches,
    DepthCodes,
    DepthPatches,
    Flags,
    Image,
    Pixels,
    Positions,
    Rgb,
    Values,
)
from hlp.kernels import compiled_ahead
from hlp.patches.sampling import sample_squares
from hlp.settings import Count, Doc, Settings

MetricSize = float | Float[np.ndarray, "n 1 1"]
"""Of all windows, or of each."""


@dataclass(frozen=True)
class HolisticSettings(Settings):
    """What a window (holistic patch) is."""

    resolution: Annotated[
        Count, Unit("px"), Doc("side of a resized window, as the network takes it (P)")
    ] = 64
    channels: Annotated[
        Literal["rgb", "rgbd"],
        Doc("rgbd distinguishes an object from things of its colour (D; P: rgb)"),
    ] = "rgbd"


@dataclass(frozen=True)
class Windows:
    """Window centres (x, y), the depth (m) that sets their side, and the side in pixels."""

    centers: Positions
    depths: Values
    sides: Values

    def at(self, rows: slice | Flags) -> "Windows":
        """The windows of some rows."""
        return Windows(self.centers[rows], self.depths[rows], self.sides[rows])


def pixel_grid(shape: tuple[int, int], step: int) -> Pixels:
    """Pixels (x, y) every `step` px, half a step away from the border, row by row."""
    y, x = np.mgrid[step // 2 : shape[0] : step, step // 2 : shape[1] : step]
    return np.stack([x.ravel(), y.ravel()], axis=1)


def center_depths(depth: Image, pixels: Pixels) -> Values:
    """Median of the depths (m) present in the 3 × 3 pixels around each pixel; 0 if none is."""
    medians = np.zeros(len(pixels), dtype=np.float32)
    single = np.ascontiguousarray(depth, dtype=np.float32)
    _fill_medians(single, np.ascontiguousarray(pixels, dtype=np.int64), medians)
    return medians


@compiled_ahead()
def _fill_medians(
    depth: Float32[np.ndarray, "h w"], pixels: Pixels, medians: Float32[np.ndarray, "n"]
) -> None:
    """Fill the lower of two middle depths, where an even number is present."""
    sorted_depths = np.empty(9, np.float32)
    for i in range(len(pixels)):
        x, y, count = pixels[i, 0], pixels[i, 1], 0
        for v in range(max(y - 1, 0), min(y + 2, depth.shape[0])):
            for u in range(max(x - 1, 0), min(x + 2, depth.shape[1])):
                if 0.0 < depth[v, u] < np.inf:
                    k = count
                    while k > 0 and sorted_depths[k - 1] > depth[v, u]:
                        sorted_depths[k] = sorted_depths[k - 1]
                        k -= 1
                    sorted_depths[k] = depth[v, u]
                    count += 1
        if count > 0:
            medians[i] = sorted_depths[(count - 1) // 2]


def metric_windows(
    depth: Image, camera_matrix: CameraMatrix, metric_size: float, step: int
) -> Windows:
    """Windows on a grid, each of side f·s/z (Eq. 1) for an object of size s (m).

    z is the depth at the window's centre; there is no window where it is missing.
    """
    centers = pixel_grid((depth.shape[0], depth.shape[1]), step)
    z = center_depths(depth, centers)
    kept = z > 0
    focal = float(camera_matrix[0, 0] + camera_matrix[1, 1]) / 2
    sides = focal * metric_size / z[kept]
    return Windows(centers[kept].astype(np.float64), z[kept], sides)


def cut_windows(
    rgb: Rgb, depth: Image, windows: Windows, metric_size: MetricSize, resolution: int
) -> tuple[ColorPatches, DepthCodes]:
    """Colour and depth of windows, resized; depth is coded by `depth_code`."""
    color = sample_squares(rgb, windows.centers, windows.sides, resolution)
    raw = sample_squares(depth, windows.centers, windows.sides, resolution, nearest=True)
    return color, depth_code(raw, windows.depths, metric_size)


def depth_code(depth: DepthPatches, center: Values, metric_size: MetricSize) -> DepthCodes:
    """Depth relative to the centre's in units of the metric size, clamped to ±1, as 1…254.

    Missing depth becomes 255, next to depth far behind the object: neither is the object.
    """
    relative = (depth - center[:, None, None]) / metric_size
    code = np.clip(np.rint(relative * 127.0), -127, 126) + 128.0
    return np.where(depth > 0, code, 255.0).astype(np.uint8)
