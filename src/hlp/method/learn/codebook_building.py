"""Builds the codebook of one object: features of its views' local patches, and their votes."""

from itertools import pairwise

import numpy as np

from hlp.arrays import Pixels
from hlp.codebook.entries import make_codebook
from hlp.codebook.neighbours import ExactNeighbours
from hlp.method.settings import CodebookStage
from hlp.models.encoder import Encoder
from hlp.patches.local import surface_pixels
from hlp.patches.local_data import degrade_patches
from hlp.patches.local_pool import cut_view_patches
from hlp.patches.sampling import join
from hlp.records import Codebook, ObjectModel, Views

_SCALE_SAMPLE = 1024
# Views whose patches are held at once. This bounds the memory, whatever the number of views, and is
# large enough to fill the encoder's chunks.
_BLOCK = 128
# Times as many pixels are drawn where flat patches are left out: three of four may be flat.
_DRAWN = 4


def build_codebook(
    model: ObjectModel, views: Views, encoder: Encoder, settings: CodebookStage
) -> Codebook:
    """Codebook of an object: local patches around pixels drawn from each view's surface.

    Its feature scale is the median distance between a patch, degraded as by a camera and clutter,
    and its match, over a sample.
    """
    local = settings.local
    size = local.side_of(model.local_size)
    rng = np.random.default_rng([settings.seed, model.object_id])
    pixels = [_draw_pixels(views, view, size, settings, rng) for view in range(len(views))]
    first = np.cumsum([0] + [len(own) for own in pixels])  # first entry of each view
    total = int(first[-1])
    sample = np.sort(rng.choice(total, min(_SCALE_SAMPLE, total), replace=False))
    features, points, sampled = [], [], []
    for start, stop in pairwise([*range(0, len(views), _BLOCK), len(views)]):
        cut = [
            cut_view_patches(views, view, pixels[view], size, local, encoder.sees_color)
            for view in range(start, stop)
        ]
        block = join(cut)
        features.append(encoder.encode(block))
        points.append(block.points_cam)
        rows = sample - first[start]
        sampled.append(block[rows[(rows >= 0) & (rows < len(block))]])
    entries, some = np.concatenate(features), join(sampled)
    poses = np.repeat(views.poses_cam_obj, np.diff(first), axis=0)
    del features, sampled, views  # the views' files count as memory while they are mapped
    seen = degrade_patches(some, np.arange(len(some)), size, settings.seed)
    nearest = ExactNeighbours(entries, 1).nearest_distances(encoder.encode(seen))
    scale = float(np.median(nearest))
    return make_codebook(model.object_id, entries, np.concatenate(points), poses, scale)


def _draw_pixels(
    views: Views, view: int, size: float, settings: CodebookStage, rng: np.random.Generator
) -> Pixels:
    """Random surface pixels (x, y) of a view, whose patches are as uneven as entries must be.

    Any, where none of the view's patches has it.
    """
    entries, least = settings.entries, settings.entries.min_plane_deviation
    if least is None:
        return surface_pixels(views.depth[view], entries.patches_per_view, rng)
    pixels = surface_pixels(views.depth[view], _DRAWN * entries.patches_per_view, rng)
    cut = cut_view_patches(views, view, pixels, size, settings.local, False, least)
    chosen = np.rint(cut.pixels).astype(np.int64) if len(cut) else pixels
    return chosen[: entries.patches_per_view]
