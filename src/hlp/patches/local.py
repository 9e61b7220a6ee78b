"""Local RGB-D patches of metric size (paper, section 3.2)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval, Le, Unit
from jaxtyping import Float, Float32, UInt8

from hlp.arrays import (
    CameraMatrix,
    DepthPatches,
    Image,
    MaskPatches,
    Pixels,
    Positions,
    Rgb,
    Values,
)
from hlp.geometry import back_project
from hlp.kernels import compiled_ahead
from hlp.patches.holistic import center_depths
from hlp.patches.sampling import sample_squares
from hlp.records import MILLIMETRE, LocalPatches
from hlp.settings import Count, Doc, Positive, PositiveOrNone, Settings, Share

_FILL_COLOR = 128  # grey
_FILL_DEPTH = 1.0  # the far end of the clamped range


@dataclass(frozen=True)
class LocalSettings(Settings):
    """What a local patch is, in views and scenes alike."""

    resolution: Annotated[
        Count, Unit("px"), Doc("side of a resized patch, as the network takes it (P)")
    ] = 32
    size_scale: Annotated[
        Positive, Doc("factor of the object's local size; larger patches vote better (D; P: 1)")
    ] = 1.5
    mask_beyond_clamp: Annotated[
        bool,
        Doc(
            "pixels beyond the metric cube are constant in colour and depth and cannot change "
            "the feature (D); otherwise depth is clamped and colour is kept (P)"
        ),
    ] = True
    size_mm: Annotated[
        PositiveOrNone,
        Unit("mm"),
        Doc(
            "side of the local patches of all objects, times `size_scale`: objects of a frame then "
            "share patches (D); null: each object's own (P)"
        ),
    ] = None

    def side_of(self, own_size: float) -> float:
        """Side (m) at which the patches of an object are cut whose own size is `own_size` (m)."""
        size = own_size if self.size_mm is None else self.size_mm * MILLIMETRE
        return size * self.size_scale


@dataclass(frozen=True)
class GridSettings(Settings):
    """Where a scene's local patches lie."""

    step: Annotated[
        Count, Le(1000), Unit("px"), Doc("step between local patches in the region (P)")
    ] = 8
    min_valid: Annotated[Share, Doc("smallest fraction of a patch within the metric cube (D)")] = (
        0.2
    )
    max_patches: Annotated[
        Count, Doc("largest number of patches; of more, those at likely windows are preferred (D)")
    ] = 400
    min_plane_deviation: Annotated[
        float | None,
        Interval(ge=0, le=1),
        Doc(
            "smallest standard deviation of a patch's depth from a plane, in halves of its size: "
            "flat patches look alike everywhere (D); null: none (P: not said)"
        ),
    ] = None


def cut_local_patches(
    rgb: Rgb,
    depth: Image,
    camera_matrix: CameraMatrix,
    pixels: Pixels,
    metric_size: float,
    settings: LocalSettings,
    min_valid: float,
    with_color: bool = True,
    min_plane_deviation: float | None = None,
) -> LocalPatches:
    """Cut patches of side f·size/z (px) around pixels (x, y), in views and test images alike.

    Dropped are patches whose centre has no depth, those with less than the share `min_valid` of
    their pixels inside the metric cube, and flat ones, of less than `min_plane_deviation`; the
    result's `pixels` are those of the rest. Depth becomes (d − z)/(size/2), clamped to ±1, with d
    and z measured along the viewing ray of the patch. A surface seen from the same side then has
    the same depth patch anywhere in the image, as `geometry.allocentric_to_egocentric` assumes.
    `metric_size` is in m. Without `with_color` the patches have no colour channels.
    """
    z = center_depths(depth, pixels)
    kept = z > 0
    pixels, z = pixels[kept], z[kept]
    focal = float(camera_matrix[0, 0] + camera_matrix[1, 1]) / 2
    sides = focal * metric_size / z
    centers, resolution = pixels.astype(np.float64), settings.resolution
    metres = np.asarray(depth, dtype=np.float32)
    relative = sample_squares(metres, centers, sides, resolution, nearest=True)
    color = np.empty((*relative.shape, 0), dtype=np.uint8)
    if with_color:
        color = sample_squares(rgb, centers, sides, resolution)
    along = _along_ray(centers, sides, resolution, camera_matrix)
    half, valid = np.float32(metric_size / 2), np.empty(relative.shape, dtype=np.bool_)
    _normalise_depth(relative, z, half, *along, settings.mask_beyond_clamp, color, valid)
    full = valid.mean(axis=(1, 2)) >= min_valid
    if min_plane_deviation is not None:
        full &= plane_deviations(relative) >= min_plane_deviation
    points = back_project(centers, z.astype(np.float64), camera_matrix)
    return LocalPatches(color[full], relative[full], valid[full], points[full], centers[full])


def plane_deviations(depth: DepthPatches) -> Values:
    """How far the depth of each patch is from its best plane: root of the mean squared residual.

    It is in the depth's unit, 0 for a plane however it is tilted. Silhouettes deviate, too.
    """
    axis = np.linspace(-1.0, 1.0, depth.shape[1])
    flat = depth.reshape(len(depth), len(axis) ** 2).astype(np.float64)
    flat -= flat.mean(axis=1, keepdims=True)
    # On a square grid the plane's two slopes are fitted independently of each other.
    slopes = np.stack([np.tile(axis, len(axis)), np.repeat(axis, len(axis))], axis=1)
    explained = np.square(flat @ slopes).sum(axis=1) / np.square(slopes[:, 0]).sum()
    squares = np.square(flat).sum(axis=1) - explained
    return np.asarray(np.sqrt(np.maximum(squares, 0.0) / flat.shape[1]))


def _along_ray(
    centers: Positions, sides: Values, resolution: int, camera_matrix: CameraMatrix
) -> tuple[Values, Float[np.ndarray, "n p"], Float[np.ndarray, "n p"]]:
    """Lengths of the centres' rays at z = 1, and factors for the depth along those rays.

    Depth along the ray, divided by its length, is depth times 1 + across[column] + down[row].
    """
    rays = back_project(centers, np.ones(len(centers)), camera_matrix)
    offsets = sides[:, None] * ((np.arange(resolution) + 0.5) / resolution - 0.5)
    shares = rays[:, :2] / (rays**2).sum(axis=1, keepdims=True) / camera_matrix[[0, 1], [0, 1]]
    return np.linalg.norm(rays, axis=1), offsets * shares[:, :1], offsets * shares[:, 1:]


@compiled_ahead()
def _normalise_depth(
    depth: Float32[np.ndarray, "n p p"],
    center_depth: Float32[np.ndarray, "n"],
    half: np.float32,
    lengths: Values,
    across: Float[np.ndarray, "n p"],
    down: Float[np.ndarray, "n p"],
    mask: bool,
    color: UInt8[np.ndarray, "n p p c"],
    valid: MaskPatches,
) -> None:
    """Replace depths (m) by relative ones along the ray and fill `valid`.

    With `mask`, pixels outside the metric cube get one constant in depth and colour.
    """
    one, fill = np.float32(1.0), np.float32(_FILL_DEPTH)
    for i in range(depth.shape[0]):
        for y in range(depth.shape[1]):
            for x in range(depth.shape[2]):
                raw = depth[i, y, x]
                ratio = np.float32(1.0 + across[i, x] + down[i, y])
                relative = np.float32(((raw * ratio - center_depth[i]) / half) * lengths[i])
                seen = raw > 0.0
                inside = seen and abs(relative) <= one
                valid[i, y, x] = inside
                depth[i, y, x] = min(max(relative, -one), one) if seen else fill
                if mask and not inside:
                    depth[i, y, x] = fill
                    for channel in range(color.shape[3]):
                        color[i, y, x, channel] = _FILL_COLOR


def surface_pixels(depth: Float[np.ndarray, "s s"], count: int, rng: np.random.Generator) -> Pixels:
    """At most `count` different random pixels (x, y) of a view's surface."""
    y, x = np.nonzero(depth > 0)
    chosen = rng.permutation(len(x))[:count]
    return np.stack([x[chosen], y[chosen]], axis=1)
