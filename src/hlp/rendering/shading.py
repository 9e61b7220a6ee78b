"""Colours of surfaces under a directional light (Blinn-Phong)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Int32, Shaped, UInt8

from hlp.arrays import CameraMatrix, Points, Rgb, Vector
from hlp.kernels import compiled, compiled_ahead

_Three = tuple[float, float, float]
_Face = Int32[np.ndarray, "3"]


class Light(NamedTuple):
    """A directional and an ambient light, both white.

    `direction` is the unit vector from the surface towards the light in camera coordinates (the
    camera looks along +z, so light from behind the camera has a negative z). `ambient`, `diffuse`
    and `specular` are strengths, 1 being the albedo itself (white for the specular one).
    """

    direction: tuple[float, float, float]
    ambient: float
    diffuse: float
    specular: float
    shininess: float


FRONTAL_LIGHT = Light((0.0, 0.0, -1.0), ambient=0.4, diffuse=0.6, specular=0.0, shininess=1.0)


def random_light(rng: np.random.Generator) -> Light:
    """A light from a random direction on the camera's side, with random strengths."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    direction[2] = -abs(direction[2])
    x, y, z = (float(value) for value in direction)
    return Light(
        direction=(x, y, z),
        ambient=float(rng.uniform(0.3, 0.9)),
        diffuse=float(rng.uniform(0.2, 0.9)),
        specular=float(rng.uniform(0.0, 0.4)),
        shininess=float(rng.uniform(5.0, 40.0)),
    )


@compiled()
def shade(albedo: _Three, normal: _Three, view: _Three, light: Light) -> tuple[int, int, int]:
    """Colour (0…255) of a surface point under a light (Blinn-Phong).

    `albedo` in 0…255, `normal` and `view` (from the surface towards the camera) in camera
    coordinates, of any length. Both sides of a surface are lit: a normal that points away from the
    camera is flipped, because normals of scanned meshes are unreliable.
    """
    nx, ny, nz = _unit(normal[0], normal[1], normal[2])
    vx, vy, vz = _unit(view[0], view[1], view[2])
    side = -1.0 if nx * vx + ny * vy + nz * vz < 0.0 else 1.0
    lx, ly, lz = light.direction
    hx, hy, hz = _unit(vx + lx, vy + ly, vz + lz)
    diffuse = max(side * (nx * lx + ny * ly + nz * lz), 0.0)
    highlight = 0.0
    if diffuse > 0.0 and light.specular > 0.0:
        halfway = max(side * (nx * hx + ny * hy + nz * hz), 0.0)
        highlight = 255.0 * light.specular * halfway**light.shininess
    lit = light.ambient + light.diffuse * diffuse
    red, green, blue = albedo[0] * lit, albedo[1] * lit, albedo[2] * lit
    return _level(red + highlight), _level(green + highlight), _level(blue + highlight)


@compiled(inline="always")
def _level(color: float) -> int:
    return int(min(max(np.rint(color), 0.0), 255.0))


@compiled(inline="always")
def _unit(x: float, y: float, z: float) -> _Three:
    """A vector scaled to unit length; one of length 0 stays 0."""
    length = np.sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length > 0.0 else 0.0
    return x * scale, y * scale, z * scale


class Surface(NamedTuple):
    """A placed mesh: number of its first face, its arrays, and its rotation to the camera."""

    first: int
    faces: Int32[np.ndarray, "f 3"]
    points_cam: Points
    normals: Points
    colors: UInt8[np.ndarray, "v 3"]
    rotation: Float[np.ndarray, "3 3"]


@compiled_ahead()
def shade_surface(
    surface: Surface,
    triangles: Int32[np.ndarray, "h w"],
    camera: CameraMatrix,
    light: Light,
    part: int,
    rgb: Rgb,
    index: Int[np.ndarray, "h w"],
) -> None:
    """Fill in the colours and the number of one part where its faces are seen."""
    height, width = triangles.shape
    last, rotation = surface.first + len(surface.faces), surface.rotation
    for y in range(height):
        for x in range(width):
            if not surface.first <= triangles[y, x] < last:
                continue
            face = surface.faces[triangles[y, x] - surface.first]
            ray_x, ray_y = (x - camera[0, 2]) / camera[0, 0], (y - camera[1, 2]) / camera[1, 1]
            weights = _corner_weights(surface.points_cam, face, ray_x, ray_y)
            albedo = _mean(surface.colors, face, weights)
            point = _mean(surface.points_cam, face, weights)
            own = _mean(surface.normals, face, weights)
            normal = _dot(rotation[0], own), _dot(rotation[1], own), _dot(rotation[2], own)
            view = -point[0], -point[1], -point[2]
            rgb[y, x, 0], rgb[y, x, 1], rgb[y, x, 2] = shade(albedo, normal, view, light)
            index[y, x] = part


@compiled(inline="always")
def _mean(values: Shaped[np.ndarray, "v 3"], face: _Face, weights: _Three) -> _Three:
    """Weighted mean of the values at a face's corners."""
    a, b, c = values[face[0]], values[face[1]], values[face[2]]
    u, v, w = weights
    x, y = u * a[0] + v * b[0] + w * c[0], u * a[1] + v * b[1] + w * c[1]
    return x, y, u * a[2] + v * b[2] + w * c[2]


@compiled(inline="always")
def _dot(row: Vector, vector: _Three) -> float:
    return float(row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2])


@compiled(inline="always")
def _corner_weights(points_cam: Points, face: _Face, ray_x: float, ray_y: float) -> _Three:
    """Perspective-correct weights of a face's corners where a pixel's ray (x, y, 1) meets it."""
    a, b, c = points_cam[face[0]], points_cam[face[1]], points_cam[face[2]]
    # The ray's three volumes with the edges, one for the corner opposite to each edge.
    u, v, w = _volume(b, c, ray_x, ray_y), _volume(c, a, ray_x, ray_y), _volume(a, b, ray_x, ray_y)
    side = np.sign(u + v + w)
    u, v, w = max(u * side, 0.0), max(v * side, 0.0), max(w * side, 0.0)
    total = u + v + w
    if total == 0.0:  # seen from its very edge
        return 1.0, 0.0, 0.0
    return u / total, v / total, w / total


@compiled(inline="always")
def _volume(start: Vector, end: Vector, ray_x: float, ray_y: float) -> float:
    """Six times the volume between a ray (x, y, 1) and an edge."""
    cross_x = start[1] * end[2] - start[2] * end[1]
    cross_y = start[2] * end[0] - start[0] * end[2]
    cross_z = start[0] * end[1] - start[1] * end[0]
    return float(cross_x * ray_x + cross_y * ray_y + cross_z)
