"""An object's surface colours in a grid of cells, to be read at any point near the surface."""

from functools import lru_cache

import numpy as np

from hlp.records import ColorGrid, Mesh
from hlp.rendering.surface_samples import sample_surface

_CELLS = 160  # along the bounding box's diagonal: 1.2 mm for 20 cm, a pixel's width at 0.7 m
_SAMPLES_PER_CELL = 3.0
_BLUR = 1.2  # cells
_MARGIN = 4  # cells around the bounding box


def color_grid(mesh: Mesh) -> ColorGrid:
    """The colours of a mesh, from its texture if it has one, in cells.

    A cell has the mean colour of the surface in it and beside it (a Gaussian of 1.2 cells), or the
    colour of the nearest cell with a surface. The grid is made once for each mesh.
    """
    return _made(mesh) if mesh.color_grid is None else mesh.color_grid


@lru_cache(maxsize=64)
def _made(mesh: Mesh) -> ColorGrid:
    from scipy.ndimage import distance_transform_edt, gaussian_filter  # slow to import

    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    cell = float(np.linalg.norm(high - low)) / _CELLS
    corner = low - _MARGIN * cell
    shape = tuple(np.ceil((high - low) / cell).astype(int) + 2 * _MARGIN)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2.0
    samples = sample_surface(mesh, int(_SAMPLES_PER_CELL * area / cell**2) + 1)
    cells = np.floor((samples.points - corner) / cell).astype(np.int64)
    flat = np.ravel_multi_index(tuple(cells.T), shape)
    size = int(np.prod(shape))
    count = np.bincount(flat, minlength=size).reshape(shape).astype(np.float64)
    weight = gaussian_filter(count, _BLUR, truncate=2.0)
    nearest = tuple(distance_transform_edt(count == 0, return_distances=False, return_indices=True))
    colors = np.empty((*shape, 3), dtype=np.uint8)
    for channel in range(3):
        total = np.bincount(flat, samples.colors[:, channel], minlength=size).reshape(shape)
        mean = gaussian_filter(total, _BLUR, truncate=2.0) / np.maximum(weight, 1e-9)
        colors[..., channel] = np.clip(np.rint(mean), 0, 255)[nearest]
    return ColorGrid(colors, corner, cell)
