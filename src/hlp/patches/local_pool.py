"""Training pairs for the contrastive encoder and patches for the autoencoder (stage 2)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float, UInt8

from hlp.arrays import Flags, Pixels, Points, Rows, Values
from hlp.geometry import back_project, project, transform
from hlp.patches.holistic import pixel_grid
from hlp.patches.local import LocalSettings, cut_local_patches
from hlp.patches.sampling import bleed_color, join
from hlp.records import Frame, LocalPatches, Views
from hlp.settings import Count, Doc, NotNegative, Settings

_FRAME_MIN_VALID = 0.2
_SAME_SURFACE = 0.005  # m: a point is visible in a view whose depth agrees this well


@dataclass(frozen=True)
class PairSettings(Settings):
    """Which local patches count as the same: those of one surface point in two near views (D)."""

    per_object: Annotated[Count, Doc("number of pairs for each object (D)")] = 5000
    max_angle_deg: Annotated[NotNegative, Doc("largest angle between the two views (D)")] = 12.0


@dataclass(frozen=True)
class PairPool:
    """Pairs of local patches that show the same surface point in two views.

    `sizes` (m) are those of the patches, `points_obj` the points in object coordinates (m),
    `rotations` those of the first view (cam_obj).
    """

    color: UInt8[np.ndarray, "n 2 p p 3"]
    depth: Float[np.ndarray, "n 2 p p"]
    valid: Bool[np.ndarray, "n 2 p p"]
    sizes: Values
    object_ids: Rows
    points_obj: Points
    rotations: Float[np.ndarray, "n 3 3"]


def bake_pairs(
    views: Views,
    side: float,
    local: LocalSettings,
    pairs: PairSettings,
    rng: np.random.Generator,
    with_color: bool,
) -> PairPool:
    """Cut pairs of patches around the same surface point in neighbouring views of one object.

    Colour takes half of the time: without `with_color` the patches have no colour channels.
    """
    first, second = _neighbouring_views(views, pairs, rng)
    pixels, points_obj = _surface_points(views, first, rng)
    partner_pixels, visible = _seen_from(views, second, points_obj)
    # Where the point is not visible in the second view, the pair is the first patch twice.
    second = np.where(visible, second, first)
    partner_pixels = np.where(visible[:, None], partner_pixels, pixels)
    a = _cut_by_view(views, first, pixels, side, local, with_color)
    b = _cut_by_view(views, second, partner_pixels, side, local, with_color)
    count = len(first)
    return PairPool(
        np.stack([a.color, b.color], axis=1),
        np.stack([a.depth, b.depth], axis=1).astype(np.float16),
        np.stack([a.valid, b.valid], axis=1),
        np.full(count, side, dtype=np.float32),
        np.full(count, views.object_id),
        points_obj.astype(np.float32),
        views.poses_cam_obj[first, :3, :3].astype(np.float32),
    )


def bake_frame_patches(
    frames: Sequence[Frame],
    sides: Sequence[float],
    per_frame: int,
    local: LocalSettings,
    rng: np.random.Generator,
) -> list[LocalPatches]:
    """About `per_frame` local patches of each RGB-D frame, for the autoencoder.

    They are divided evenly among the `sides` (m).
    """
    found = []
    for frame in frames:
        shape = (frame.depth.shape[0], frame.depth.shape[1])
        grid, image = pixel_grid(shape, 2), (frame.rgb, frame.depth, frame.camera_matrix)
        for side in sides:
            count = min(per_frame // len(sides), len(grid))
            pixels = grid[rng.choice(len(grid), count, replace=False)]
            found.append(cut_local_patches(*image, pixels, side, local, _FRAME_MIN_VALID))
    return found


def _neighbouring_views(
    views: Views, pairs: PairSettings, rng: np.random.Generator
) -> tuple[Rows, Rows]:
    first = np.sort(rng.integers(len(views), size=pairs.per_object))
    flat = views.poses_cam_obj[:, :3, :3].reshape(-1, 9)
    limit = 1.0 + 2.0 * np.cos(np.deg2rad(pairs.max_angle_deg))
    second = np.empty_like(first)
    for view in np.unique(first):
        rows = np.flatnonzero(first == view)
        near = flat @ flat[view] >= limit
        near[view] = True  # in spite of rounding
        second[rows] = rng.choice(np.flatnonzero(near), len(rows))
    return first, second


def _surface_points(views: Views, chosen: Rows, rng: np.random.Generator) -> tuple[Pixels, Points]:
    pixels = np.empty((len(chosen), 2), dtype=np.int64)
    points = np.empty((len(chosen), 3))
    for view in np.unique(chosen):
        rows = np.flatnonzero(chosen == view)
        depth = np.asarray(views.depth[view])
        y, x = np.nonzero(depth > 0)
        drawn = rng.integers(len(x), size=len(rows))
        pixels[rows] = np.stack([x[drawn], y[drawn]], axis=1)
        z = depth[y[drawn], x[drawn]].astype(np.float64)
        cam = back_project(pixels[rows].astype(np.float64), z, views.camera_matrix)
        pose = views.poses_cam_obj[view]
        points[rows] = (cam - pose[:3, 3]) @ pose[:3, :3]
    return pixels, points


def _seen_from(views: Views, chosen: Rows, points_obj: Points) -> tuple[Pixels, Flags]:
    cam = transform(views.poses_cam_obj[chosen], points_obj[:, None, :])[:, 0]
    size = views.depth.shape[1]
    pixels = np.clip(np.rint(project(cam, views.camera_matrix)), 0, size - 1).astype(np.int64)
    depth = np.asarray(views.depth[chosen, pixels[:, 1], pixels[:, 0]])
    return pixels, (depth > 0) & (np.abs(depth - cam[:, 2]) < _SAME_SURFACE)


def _cut_by_view(
    views: Views, chosen: Rows, pixels: Pixels, size: float, local: LocalSettings, with_color: bool
) -> LocalPatches:
    order = np.argsort(chosen, kind="stable")
    bounds = np.flatnonzero(np.diff(chosen[order])) + 1
    parts = [
        cut_view_patches(views, int(chosen[rows[0]]), pixels[rows], size, local, with_color)
        for rows in np.split(order, bounds)
    ]
    return join(parts)[np.argsort(order, kind="stable")]


def cut_view_patches(
    views: Views,
    view: int,
    pixels: Pixels,
    size: float,
    local: LocalSettings,
    with_color: bool,
    min_plane_deviation: float | None = None,
) -> LocalPatches:
    """Local patches of metric `size` (m) of one view around surface pixels (x, y).

    All that are not too flat are kept, however few of their pixels are valid: a patch at a thin
    part of the object has few valid pixels in test images, too. Without `with_color` the patches
    have no colour channels.
    """
    depth, rgb = np.asarray(views.depth[view]), np.asarray(views.rgb[view])
    if with_color:
        rgb = bleed_color(rgb, depth > 0)
    camera = views.camera_matrix
    return cut_local_patches(
        rgb, depth, camera, pixels, size, local, 0.0, with_color, min_plane_deviation
    )
