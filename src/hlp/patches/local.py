"""Local RGB-D patches of metric size (paper, section 3.2)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hlp.geometry import back_project
from hlp.patches.holistic import center_depths, pixel_grid
from hlp.patches.sampling import sample_squares
from hlp.records import LocalPatches

_FILL_COLOR = 128  # mid-grey: nothing is known there
_FILL_DEPTH = 1.0  # as what lies just beyond the clamp


@dataclass(frozen=True)
class LocalSettings:
    """What a local patch is, in views and scenes alike.

    `resolution` px of its side; `size_scale` multiplies the object's `local_size`;
    `mask_beyond_clamp` replaces pixels beyond the metric cube by one constant in colour and depth
    (otherwise depth is only clamped, as the paper words it).
    """

    resolution: int
    size_scale: float
    mask_beyond_clamp: bool


@dataclass(frozen=True)
class GridSettings:
    """Where a scene's local patches lie: every `step` px of the region.

    A patch needs the share `min_valid` of its pixels within the metric cube. At most
    `max_patches` are taken, evenly over the region.
    """

    step: int
    min_valid: float
    max_patches: int


def cut_local_patches(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth: Float[np.ndarray, "h w"],
    camera_matrix: Float[np.ndarray, "3 3"],
    pixels: Int[np.ndarray, "n 2"],
    metric_size: float,
    settings: LocalSettings,
    min_valid: float,
) -> LocalPatches:
    """Cut patches of side f·size/z around pixels (x, y), the same way in views and scenes.

    Pixels without depth give no patch, nor do patches with less than the share `min_valid` inside
    the metric cube; the result tells which remained. Depth becomes (d − z)/(size/2), clamped to ±1.
    """
    z = center_depths(depth, pixels)
    kept = z > 0
    pixels, z = pixels[kept], z[kept]
    focal = float(camera_matrix[0, 0] + camera_matrix[1, 1]) / 2
    sides = focal * metric_size / z
    centers = pixels.astype(np.float64)
    color = sample_squares(rgb, centers, sides, settings.resolution)
    raw = sample_squares(depth, centers, sides, settings.resolution, nearest=True)
    relative = (raw - z[:, None, None]) / np.float32(metric_size / 2)
    valid = (raw > 0) & (np.abs(relative) <= 1.0)
    relative = np.where(raw > 0, np.clip(relative, -1.0, 1.0), _FILL_DEPTH).astype(np.float32)
    if settings.mask_beyond_clamp:
        relative[~valid] = _FILL_DEPTH
        color[~valid] = _FILL_COLOR
    full = valid.mean(axis=(1, 2)) >= min_valid
    points = back_project(centers, z.astype(np.float64), camera_matrix)
    return LocalPatches(color[full], relative[full], valid[full], points[full], centers[full])


def region_pixels(mask: Bool[np.ndarray, "h w"], settings: GridSettings) -> Int[np.ndarray, "n 2"]:
    """Pixels (x, y) of the grid that lie in a candidate region, thinned evenly to the limit."""
    grid = pixel_grid((mask.shape[0], mask.shape[1]), settings.step)
    inside = np.asarray(grid[mask[grid[:, 1], grid[:, 0]]])
    if len(inside) <= settings.max_patches:
        return inside
    chosen = np.linspace(0, len(inside) - 1, settings.max_patches).astype(int)
    return np.asarray(inside[chosen])


def surface_pixels(
    depth: Float[np.ndarray, "s s"], count: int, rng: np.random.Generator
) -> Int[np.ndarray, "n 2"]:
    """Pixels (x, y) drawn from a view's surface, at most `count`, without repetition."""
    y, x = np.nonzero(depth > 0)
    chosen = rng.permutation(len(x))[:count]
    return np.stack([x[chosen], y[chosen]], axis=1)
