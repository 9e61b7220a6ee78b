"""Directional light and Blinn-Phong shading of rendered surfaces."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from hlp.arrays import Points


@dataclass(frozen=True)
class Light:
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


def shade(
    albedo: Points | UInt8[np.ndarray, "n 3"],
    normals: Points,
    view_directions: Points,
    light: Light,
) -> UInt8[np.ndarray, "n 3"]:
    """Colours (0…255) of surface points under a light (Blinn-Phong).

    `albedo` in 0…255, `normals` and `view_directions` (from the surface towards the camera) in
    camera coordinates, of any length. Both sides of a surface are lit: a normal that points away
    from the camera is flipped, because normals of scanned meshes are unreliable.
    """
    normals, view = _unit(normals), _unit(view_directions)
    facing = np.where(np.einsum("ij,ij->i", normals, view) < 0.0, -1.0, 1.0)
    normals = normals * facing[:, None]
    towards = np.asarray(light.direction, dtype=np.float64)
    diffuse = np.maximum(normals @ towards, 0.0)
    halfway = np.maximum(np.einsum("ij,ij->i", normals, _unit(view + towards)), 0.0)
    highlight = np.where(diffuse > 0.0, halfway**light.shininess, 0.0)
    color = np.asarray(albedo, dtype=np.float64) * (
        light.ambient + light.diffuse * diffuse[:, None]
    )
    color += 255.0 * light.specular * highlight[:, None]
    return np.asarray(np.clip(np.rint(color), 0, 255), dtype=np.uint8)


def _unit(vectors: Points) -> Points:
    """Vectors scaled to unit length; a vector of length 0 stays 0."""
    vectors = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))
