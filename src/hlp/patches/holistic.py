"""Holistic patches: windows of an object's metric size (paper, section 3.1, Eq. 1)."""

from dataclasses import dataclass
from typing import Annotated, Literal

import cv2
import numpy as np
from annotated_types import Interval, Le, Unit
from jaxtyping import Float

from hlp.arrays import (
    CameraMatrix,
    ColorPatches,
    DepthCodes,
    DepthPatches,
    Flags,
    Image,
    Mask,
    Pixels,
    Positions,
    Rgb,
    Values,
)
from hlp.kernels import compiled_ahead
from hlp.patches.sampling import sample_squares
from hlp.records import Region
from hlp.settings import Count, Doc, PositiveOrNone, Settings, WholeNumber

_MIN_WEIGHT = 0.01
_COMPARABLE = 0.1
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
class RegionSettings(Settings):
    """Where windows lie and how their probabilities become a region."""

    step: Annotated[
        Count,
        Le(1000),
        Unit("px"),
        Doc("step between windows; 16 makes a quarter of the paper's (D; P: 8)"),
    ] = 16
    threshold: Annotated[
        float | None,
        Interval(gt=0, le=1),
        Doc("windows with p(object) above this are accepted (D); null: the most likely class (P)"),
    ] = 0.08
    min_windows: Annotated[
        WholeNumber,
        Doc(
            "if fewer are, the most probable up to this number are accepted too, but none that is "
            "less than a tenth as probable as the first (D; P: 0)"
        ),
    ] = 8
    square_side: Annotated[
        PositiveOrNone,
        Doc(
            "side, in diameters, of the squares around the windows' centres that make up the "
            "region (D); null: the windows themselves (P)"
        ),
    ] = 0.7
    scan: Annotated[
        Literal["exact", "fast"],
        Doc(
            "windows that are classified: all (exact, P), or every other one that is not on a "
            "large plane, once for object sizes up to a quarter apart (fast, D)"
        ),
    ] = "fast"


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
    padded = cv2.copyMakeBorder(depth, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    x, y = pixels[:, 0], pixels[:, 1]
    near = np.stack([padded[y + dy, x + dx] for dy in range(3) for dx in range(3)], axis=1)
    near = np.sort(np.where(near > 0, near, np.inf), axis=1)
    present = np.isfinite(near).sum(axis=1)
    middle = near[np.arange(len(near)), np.maximum(present - 1, 0) // 2]
    return np.where(present > 0, middle, 0.0).astype(np.float32)


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


def candidate_region(
    object_id: int,
    windows: Windows,
    probabilities: Values,
    is_best: Flags,
    shape: tuple[int, int],
    extent: float,
    settings: RegionSettings,
) -> Region:
    """Union of the accepted windows, or of squares around their centres (paper, section 3.1).

    `is_best` is True where the object is the arg-max class. `extent` is the object's diameter in
    units of the windows' metric size: a long object may extend beyond the union of its windows.
    """
    accepted = is_best if settings.threshold is None else probabilities > settings.threshold
    if accepted.sum() < settings.min_windows and len(probabilities):
        order = np.argsort(-probabilities, kind="stable")[: settings.min_windows]
        comparable = probabilities[order] >= _COMPARABLE * probabilities.max()
        accepted = accepted.copy()
        accepted[order[comparable]] = True
    scale = 1.0 if settings.square_side is None else settings.square_side * extent
    half_sides = windows.sides[accepted] * scale / 2
    mask = union_of_squares(windows.centers[accepted], half_sides, shape)
    return Region(object_id, windows.centers, probabilities, mask)


def region_weights(region: Region, pixels: Positions, radii: Values) -> Values:
    """Weights, 0.01…1, of pixels (x, y): how probable it is that they show the region's object.

    The largest probability among the windows whose centres are within `radii` px, half the object's
    extent. Patches near windows of low probability should not outvote those near likely ones.
    """
    order = np.argsort(-region.probabilities)[: np.sum(region.probabilities > _MIN_WEIGHT)]
    windows = region.centers[order], region.probabilities[order]
    weights = np.full(len(pixels), _MIN_WEIGHT, windows[1].dtype).astype(np.float64)
    of = pixels, radii, *windows, weights
    _fill_from_likeliest(*(np.ascontiguousarray(part, np.float64) for part in of))
    return weights


@compiled_ahead()
def _fill_from_likeliest(
    pixels: Positions, radii: Values, centers: Positions, likely: Values, weights: Values
) -> None:
    """Fill the weights of pixels with a window near enough; the likeliest windows come first."""
    for i in range(len(pixels)):
        for k in range(len(centers)):
            dx, dy = pixels[i, 0] - centers[k, 0], pixels[i, 1] - centers[k, 1]
            if dx * dx + dy * dy <= radii[i] * radii[i]:
                weights[i] = likely[k]
                break


def union_of_squares(centers: Positions, half_sides: Values, shape: tuple[int, int]) -> Mask:
    """Pixels within any square."""
    mask = np.zeros(shape, dtype=bool)
    first = np.maximum(np.rint(centers - half_sides[:, None]), 0).astype(int).tolist()
    end = np.maximum(np.rint(centers + half_sides[:, None]) + 1, 0).astype(int).tolist()
    for (left, top), (right, bottom) in zip(first, end, strict=True):
        mask[top:bottom, left:right] = True
    return mask
