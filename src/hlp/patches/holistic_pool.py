"""Training windows for the holistic classifier, cut once from the views (paper, section 3.1).

A pool holds rendered windows: geometry, light and the object's colour. Backgrounds, occluders and
changes of colour and depth are drawn for every batch (`hlp.patches.holistic_data`), which takes a
tenth of the time of cutting windows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from hlp.arrays import ColorPatches, DepthCodes, Flags, MaskPatches, Pixels, Rows, Values, spread
from hlp.geometry import project
from hlp.patches.composite import BackgroundPool
from hlp.patches.holistic import Windows, cut_windows
from hlp.patches.sampling import bleed_color, join
from hlp.records import Frame, ObjectModel, Views
from hlp.settings import Count, Doc, NotNegative, Settings, Share, WholeNumber

BACKGROUND = 0


@dataclass(frozen=True)
class HolisticPoolSettings(Settings):
    """What the classifier is shown (D; P: "composited on PASCAL VOC crops").

    What lies between centred and badly centred is not shown.
    """

    per_object: Annotated[Count, Doc("windows cut from each object's views (D)")] = 3000
    off_center: Annotated[
        Share, Doc("fraction that is badly centred and labelled background (D)")
    ] = 0.25
    wrong_scale: Annotated[
        Share, Doc("fraction with another object's size, labelled background (D)")
    ] = 0.10
    background_share: Annotated[
        Share,
        Doc(
            "fraction of each batch that shows only background; at least as much as one object, so "
            "1/2 where one is learnt, 1/3 where two are (D)"
        ),
    ] = 0.25
    center_tolerance: Annotated[
        NotNegative,
        Doc("largest offset of a centred window from the centroid, in window sides (D)"),
    ] = 0.30
    off_center_from: Annotated[
        NotNegative, Doc("smallest offset of a badly centred window, in window sides (D)")
    ] = 0.45
    scale_jitter: Annotated[NotNegative, Doc("largest relative change of a window's size (D)")] = (
        0.08
    )
    backgrounds: Annotated[
        Count,
        Doc(
            "crops of photographs, and of each kind of RGB-D frames; no more than windows of the "
            "objects (D)"
        ),
    ] = 8000
    distractor_scenes: Annotated[
        WholeNumber,
        Doc(
            "rendered scenes of random shapes in the objects' sizes, colours and prints, of which "
            "as many crops are backgrounds (D); fewer if there are fewer crops; 0: none"
        ),
    ] = 100

    def background_share_for(self, objects: int) -> float:
        """The fraction of each batch that shows only background, for a number of objects."""
        return max(self.background_share, 1.0 / (objects + 1))

    def object_odds(self, objects: int) -> float:
        """Windows of one object in a batch for each window labelled background."""
        shown = 1.0 - self.background_share_for(objects)
        labelled = shown * (1.0 - self.off_center - self.wrong_scale)
        labelled = min(max(labelled, 1e-6), 1.0 - 1e-6)  # pools of one kind of window alone
        return labelled / objects / (1.0 - labelled)


@dataclass(frozen=True)
class HolisticPool:
    """Windows of objects with labels, `BACKGROUND` (0) for none; `mask` is where the object is.

    `depth` is coded by `hlp.patches.holistic.depth_code`.
    """

    color: ColorPatches
    depth: DepthCodes
    mask: MaskPatches
    labels: Rows


def bake_windows(
    views: Views,
    model: ObjectModel,
    label: int,
    sizes: Sequence[float],
    resolution: int,
    settings: HolisticPoolSettings,
    rng: np.random.Generator,
) -> HolisticPool:
    """Cut one object's training windows by the rule for test images (Eq. 1).

    A window's side follows from the depth at its centre, not from the depth of the object's
    centroid. Windows centred beside the object have a random depth near the object's. `sizes` are
    those of all objects, for windows of a wrong one. Of an object without colours nothing is known
    of its colour: it has another one in every window.
    """
    per_view = int(np.ceil(settings.per_object / len(views)))
    order = rng.permutation(len(views))[: int(np.ceil(settings.per_object / per_view))]
    parts = [
        _view_windows(views, int(i), per_view, model, label, sizes, resolution, settings, rng)
        for i in np.sort(order)
    ]
    pool = join(parts)
    return pool if model.mesh.colored else replace(pool, color=_repainted(pool.color, rng))


def _repainted(color: ColorPatches, rng: np.random.Generator) -> ColorPatches:
    """The windows with their shading, each in another muted colour, from dark to bright."""
    count = len(color)
    mean = color.mean(axis=(1, 2, 3), dtype=np.float32)
    paint = rng.uniform(30.0, 220.0, (count, 1)) + rng.normal(0.0, 40.0, (count, 3))
    gain = np.clip(paint, 10.0, 240.0) / np.maximum(mean, 1.0)[:, None]
    painted = np.empty_like(color)
    for i in range(count):  # window by window: as floats the pool is four times as large
        painted[i] = np.clip(color[i] * gain[i].astype(np.float32), 0.0, 255.0)
    return painted


def bake_backgrounds(
    photograph_crops: ColorPatches,
    frames: Sequence[Sequence[Frame]],
    metric_sizes: Sequence[float],
    resolution: int,
    count: int,
    rng: np.random.Generator,
) -> BackgroundPool:
    """Crops of photographs (without depth) and about `count` windows of each group of frames."""
    seen = [spread([f for f in group if (f.depth > 0).any()], count) for group in frames]
    cut = [(frame, count // len(group)) for group in seen for frame in group]
    total = len(photograph_crops) + sum(share for _, share in cut)
    shape = (total, resolution, resolution)
    pool = BackgroundPool(np.empty((*shape, 3), dtype=np.uint8), np.zeros(shape, dtype=np.uint8))
    stop = len(photograph_crops)
    pool.color[:stop] = photograph_crops
    for frame, share in cut:
        rows, stop = slice(stop, stop + share), stop + share
        windows = _frame_windows(frame, metric_sizes, resolution, share, rng)
        pool.color[rows], pool.depth[rows] = windows
    return pool


def _view_windows(
    views: Views,
    index: int,
    count: int,
    model: ObjectModel,
    label: int,
    sizes: Sequence[float],
    resolution: int,
    settings: HolisticPoolSettings,
    rng: np.random.Generator,
) -> HolisticPool:
    depth, metric_size = np.asarray(views.depth[index]), model.holistic_size
    focal = float(views.camera_matrix[0, 0])
    pose = views.poses_cam_obj[index]
    center_cam = pose[:3, :3] @ model.centroid + pose[:3, 3]
    middle = project(center_cam, views.camera_matrix)
    kinds = rng.random(count)
    off_center = kinds < settings.off_center
    wrong_scale = ~off_center & (kinds < settings.off_center + settings.wrong_scale)
    pixels, z = _window_centers(depth, middle, focal, metric_size, off_center, settings, rng)
    size = metric_size * np.exp(rng.uniform(-1, 1, count) * np.log1p(settings.scale_jitter))
    other = rng.choice(np.asarray(sizes), count)
    far_scale = np.abs(np.log(other / metric_size)) > np.log(1.3)
    stretched = metric_size * np.where(rng.random(count) < 0.5, 0.55, 1.8)
    size = np.where(wrong_scale, np.where(far_scale, other, stretched), size)
    windows = Windows(pixels.astype(np.float64), z, focal * size / z)
    rgb = bleed_color(np.asarray(views.rgb[index]), depth > 0)
    color, code = cut_windows(rgb, depth, windows, size[:, None, None], resolution)
    labels = np.where(off_center | wrong_scale, BACKGROUND, label)
    return HolisticPool(color, code, code < 255, labels.astype(np.int64))


def _window_centers(
    depth: Float[np.ndarray, "s s"],
    middle: Float[np.ndarray, "2"],
    focal: float,
    metric_size: float,
    off_center: Flags,
    settings: HolisticPoolSettings,
    rng: np.random.Generator,
) -> tuple[Pixels, Values]:
    """Centres (x, y) near the centroid or off it, and the depths (m) for the windows' sides."""
    size = depth.shape[0]
    y, x = np.mgrid[:size, :size]
    on_object = depth > 0
    typical = float(np.median(depth[on_object]))
    shift = np.hypot(x - middle[0], y - middle[1]) * typical / focal / metric_size
    near = np.flatnonzero(on_object & (shift < settings.center_tolerance))
    if len(near) == 0:
        near = np.flatnonzero(on_object)
    away = np.flatnonzero((shift > settings.off_center_from) & (shift < 1.0))
    if len(away) == 0:
        away = near
    count = len(off_center)
    chosen = np.where(off_center, rng.choice(away, count), rng.choice(near, count))
    z = depth.ravel()[chosen]
    behind = typical + rng.uniform(-0.05, 0.15, len(chosen))
    return np.stack([chosen % size, chosen // size], axis=1), np.where(z > 0, z, behind)


def _frame_windows(
    frame: Frame,
    metric_sizes: Sequence[float],
    resolution: int,
    count: int,
    rng: np.random.Generator,
) -> tuple[ColorPatches, DepthCodes]:
    y, x = np.nonzero(frame.depth > 0)
    sizes = np.sort(rng.choice(metric_sizes, count))
    chosen = rng.integers(len(x), size=count)
    z = frame.depth[y[chosen], x[chosen]]
    centers = np.stack([x[chosen], y[chosen]], axis=1).astype(np.float64)
    sides = float(frame.camera_matrix[0, 0]) * sizes / z
    size_of_each = sizes.astype(z.dtype)[:, None, None]
    windows = Windows(centers, z, sides)
    return cut_windows(frame.rgb, frame.depth, windows, size_of_each, resolution)
