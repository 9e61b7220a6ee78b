"""Points, normals and sides of surfaces: spread over a mesh, with colours, or seen in an image."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from hlp.arrays import CameraMatrix, Image, Mask, Point, Points, Positions
from hlp.geometry import rigid
from hlp.kernels import compiled, compiled_ahead
from hlp.records import ColorGrid, Mesh, Texture
from hlp.rendering.rasterizer import render_depth

# Two irrational steps whose multiples fill the unit square evenly (Roberts' R2 sequence).
_STEPS = (0.7548776662466927, 0.5698402909980532)
_CELLS = 160  # along the bounding box's diagonal: 1.2 mm for 20 cm, a pixel's width at 0.7 m
_SAMPLES_PER_CELL = 3.0
_BLUR = 1.2  # cells
_FAR, _RADIUS = 100, 64  # a side is measured from so many radii away, with so many pixels a radius
_MARGIN = 4  # cells around the bounding box


class SurfaceSamples(NamedTuple):
    """Points (m) on a surface, the unit normals of their triangles, and their colours (0…255)."""

    points: Points
    normals: Points
    colors: Float32[np.ndarray, "n 3"]


def sample_surface(mesh: Mesh, count: int) -> SurfaceSamples:
    """`count` points, as many on each triangle as its area asks for; the same ones every time."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    reached = np.cumsum(double_area)
    places = (np.arange(count) + 0.5) * (reached[-1] / count)
    face = np.minimum(np.searchsorted(reached, places), len(reached) - 1)
    square = (0.5 + np.arange(count)[:, None] * np.array(_STEPS)) % 1.0
    folded = np.where(square.sum(axis=1, keepdims=True) > 1.0, 1.0 - square, square)
    weights = np.concatenate([folded, 1.0 - folded.sum(axis=1, keepdims=True)], axis=1)
    corners = mesh.faces[face]
    points = np.einsum("ni,nij->nj", weights, mesh.vertices[corners])
    normals = cross[face] / np.maximum(double_area[face], 1e-300)[:, None]
    if mesh.texture is None:
        mixed = np.einsum("ni,nij->nj", weights, mesh.colors[corners].astype(np.float64))
        colors = mixed.astype(np.float32)
    else:
        uv = np.einsum("ni,nij->nj", weights, mesh.texture.uv[corners])
        colors = sample_texture(mesh.texture, uv)
    return SurfaceSamples(points, normals, colors)


def sample_texture(texture: Texture, uv: Positions) -> Float32[np.ndarray, "n 3"]:
    """Colours (0…255) at texture coordinates, linear between the four nearest texels."""
    height, width = texture.image.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1.0 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right_share = (x - left)[:, None].astype(np.float32)
    bottom_share = (y - top)[:, None].astype(np.float32)
    rows = [top % height, (top + 1) % height]
    columns = [left % width, (left + 1) % width]
    image = texture.image
    upper, lower = (
        image[row, columns[0]] * (1 - right_share) + image[row, columns[1]] * right_share
        for row in rows
    )
    return np.asarray(upper * (1 - bottom_share) + lower * bottom_share, dtype=np.float32)


def color_grid(mesh: Mesh) -> ColorGrid:
    """The colours of a mesh, from its texture if it has one, in cells.

    A cell has the mean colour of the surface in it and beside it (a Gaussian of 1.2 cells), or the
    colour of the nearest cell with a surface. The grid is made once for each mesh.
    """
    return _made(mesh) if mesh.color_grid is None else mesh.color_grid


@lru_cache(maxsize=64)
def broadest_side(mesh: Mesh) -> float:
    """Area (m²) of the largest of a mesh's three silhouettes along its principal axes."""
    middle, (_, axes) = mesh.vertices.mean(axis=0), np.linalg.eigh(np.cov(mesh.vertices.T))
    radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
    turns = np.stack([np.roll(axes.T, shift, axis=0) for shift in range(3)])
    poses = rigid(turns, np.array([0.0, 0.0, _FAR * radius]) - turns @ middle)
    focal, center = float(_FAR * _RADIUS), float(_RADIUS)
    camera_matrix = np.array([[focal, 0.0, center], [0.0, focal, center], [0.0, 0.0, 1.0]])
    shape = 2 * _RADIUS + 1, 2 * _RADIUS + 1
    drawn = np.count_nonzero(render_depth(mesh, poses, camera_matrix, shape, 1), axis=(1, 2))
    return max(float(drawn.max()), 1.0) * (radius / _RADIUS) ** 2  # a wire covers no pixel


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


@compiled_ahead()
def surface_and_normals(
    depth: Float32[np.ndarray, "h w"], used: Mask, count: int, camera: CameraMatrix
) -> tuple[Points, Points]:
    """Points (m, camera coordinates) that the `count` used pixels show, row by row, and normals.

    Normals are of length 1, from the neighbours of each pixel; at the image's border from one
    direction alone, so 0.
    """
    height, width = depth.shape
    points, normals = np.empty((count, 3)), np.empty((count, 3))
    left, right, above, below = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    row = 0
    for y in range(height):
        for x in range(width):
            if not used[y, x]:
                continue
            _back_project(x, y, depth, camera, points[row])
            normal = normals[row]
            row += 1
            if not (0 < x < width - 1 and 0 < y < height - 1):
                normal[:] = 0.0
                continue
            _back_project(x - 1, y, depth, camera, left)
            _back_project(x + 1, y, depth, camera, right)
            _back_project(x, y - 1, depth, camera, above)
            _back_project(x, y + 1, depth, camera, below)
            for k in range(3):
                right[k] -= left[k]
                below[k] -= above[k]
            normal[0] = right[1] * below[2] - right[2] * below[1]
            normal[1] = right[2] * below[0] - right[0] * below[2]
            normal[2] = right[0] * below[1] - right[1] * below[0]
            squared = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
            for k in range(3):
                normal[k] /= max(np.sqrt(squared), 1e-12)
    return points, normals


@compiled(inline="always")
def _back_project(x: int, y: int, depth: Image, camera: CameraMatrix, point: Point) -> None:
    """Fill the point (m) that a pixel shows, as `geometry.back_project` computes it."""
    z = float(depth[y, x])
    point[0] = (x - camera[0, 2]) / camera[0, 0] * z
    point[1] = (y - camera[1, 2]) / camera[1, 1] * z
    point[2] = z
