"""Points spread evenly over a mesh, with their normals and colours."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from hlp.records import Mesh, Texture

# Two irrational steps whose multiples fill the unit square evenly (Roberts' R2 sequence).
_STEPS = (0.7548776662466927, 0.5698402909980532)


@dataclass(frozen=True)
class SurfaceSamples:
    """Points (m) on a surface, the unit normals of their triangles, and their colours (0…255)."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    colors: Float32[np.ndarray, "n 3"]

    def __len__(self) -> int:
        return len(self.points)


def sample_surface(mesh: Mesh, count: int) -> SurfaceSamples:
    """`count` points, as many on each triangle as its area asks for; the same ones every time."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=1)
    reached = np.cumsum(double_area)
    wanted = (np.arange(count) + 0.5) * (reached[-1] / count)
    face = np.minimum(np.searchsorted(reached, wanted), len(reached) - 1)
    weights = _corner_weights(count)
    corners = mesh.faces[face]
    points = np.einsum("ni,nij->nj", weights, mesh.vertices[corners])
    normals = cross[face] / np.maximum(double_area[face], 1e-300)[:, None]
    return SurfaceSamples(points, normals, surface_colors(mesh, corners, weights))


def surface_colors(
    mesh: Mesh, corners: Int[np.ndarray, "n 3"], weights: Float[np.ndarray, "n 3"]
) -> Float32[np.ndarray, "n 3"]:
    """Colours (0…255) at weighted means of triangles' corners, from the texture if it exists."""
    if mesh.texture is None:
        mixed = np.einsum("ni,nij->nj", weights, mesh.colors[corners].astype(np.float64))
        return np.asarray(mixed, dtype=np.float32)
    uv = np.einsum("ni,nij->nj", weights, mesh.texture.uv[corners])
    return sample_texture(mesh.texture, uv)


def sample_texture(texture: Texture, uv: Float[np.ndarray, "n 2"]) -> Float32[np.ndarray, "n 3"]:
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


def _corner_weights(count: int) -> Float[np.ndarray, "n 3"]:
    """Weights of the corners of a triangle that spread points evenly over it."""
    index = np.arange(count)[:, None]
    square = (0.5 + index * np.array(_STEPS)) % 1.0
    folded = np.where(square.sum(axis=1, keepdims=True) > 1.0, 1.0 - square, square)
    return np.concatenate([folded, 1.0 - folded.sum(axis=1, keepdims=True)], axis=1)
