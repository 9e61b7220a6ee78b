"""Viewpoints distributed evenly over a sphere, and the rotations of cameras placed there.

The paper (stage 0) places its cameras like equal charges at rest on a sphere (Thomson problem).
Directions are unit vectors in object coordinates; angles are radians.
"""

import numpy as np
from jaxtyping import Bool, Float

from hlp.arrays import Points, Values

_MIRROR = np.array([1.0, 1.0, -1.0])
# Below this distance from the pole the object's +z has no direction in the image.
_POLE = 1e-6


def thomson(count: int, seed: int) -> Points:
    """`count` directions over the whole sphere at a minimum of the Coulomb energy.

    Starts from uniform random directions and finds a local minimum. Its energy is within 0.01 % of
    the best known (Wales & Ulker 2006) for the counts tested, 2 to 400.
    Raises ValueError if `count` < 1.
    """
    return _relax(_random_directions(count, seed), mirrored=False)


def hemisphere(count: int, seed: int) -> Points:
    """`count` directions on the upper half (z > 0) of the sphere, as evenly as `thomson`'s.

    Each charge has a mirror image below the equator, so this is the upper half of a symmetric
    solution for 2·count charges: the lowest ring stays half a spacing above the equator.
    Raises ValueError if `count` < 1.
    """
    start = _random_directions(count, seed)
    start[:, 2] = np.abs(start[:, 2])
    return _relax(start, mirrored=True)


def view_rotations(viewpoints: Points, in_plane: Values) -> Float[np.ndarray, "nm 3 3"]:
    """Rotations `cam_obj` (n·m, 3, 3), viewpoint-major, of cameras at `viewpoints` (n, 3).

    The camera looks from each viewpoint at the object's centre; the object's +z points up in the
    image (at the poles its +y does), then the image is turned about the optical axis by each
    angle of `in_plane` (m,) in rad (positive takes the image's x axis towards its y axis).
    """
    backward = viewpoints / np.linalg.norm(viewpoints, axis=-1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0]) - backward[:, 2:] * backward
    at_pole = np.linalg.norm(up, axis=-1) < _POLE
    up[at_pole] = np.array([0.0, 1.0, 0.0]) - backward[at_pole, 1:2] * backward[at_pole]
    y_axis = -up / np.linalg.norm(up, axis=-1, keepdims=True)
    z_axis = -backward
    upright = np.stack([np.cross(y_axis, z_axis), y_axis, z_axis], axis=1)
    turns = turns_in_plane(in_plane)
    return np.asarray(np.einsum("mij,njk->nmik", turns, upright).reshape(-1, 3, 3))


def turns_in_plane(angles: Values) -> Float[np.ndarray, "n 3 3"]:
    """Rotations about the optical axis, from the image's x axis towards its y axis."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 2, 2] = np.sin(angles), 1.0
    turns[:, 0, 1] = -turns[:, 1, 0]
    return turns


def _random_directions(count: int, seed: int) -> Points:
    if count < 1:
        raise ValueError(f"the number of viewpoints must be at least 1, got {count}")
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def _relax(start: Points, mirrored: bool) -> Points:
    """Nearest minimum of the Coulomb energy, by L-BFGS over unnormalised vectors.

    The energy depends on the directions only, so the sphere needs no constraint.
    """
    if len(start) == 1 and not mirrored:
        return start  # a single charge is at rest anywhere

    def energy(flat: Values) -> tuple[float, Values]:
        vectors = flat.reshape(-1, 3)
        norms = np.linalg.norm(vectors, axis=1, keepdims=True)
        points = vectors / norms
        own = np.eye(len(points), dtype=bool)
        value, slope = _repulsion(points, points, own)
        if mirrored:
            below, below_slope = _repulsion(points, points * _MIRROR, np.zeros_like(own))
            value, slope = value + below, slope + below_slope
        tangent = slope - (slope * points).sum(axis=1, keepdims=True) * points
        return value, (tangent / norms).ravel()

    from scipy.optimize import minimize  # only learning needs it, and it is slow to import

    limits = {"maxiter": 1000, "maxfun": 2000, "ftol": 1e-11, "gtol": 1e-6}
    result = minimize(energy, start.ravel(), jac=True, method="L-BFGS-B", options=limits)
    points = result.x.reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    if mirrored:
        # A charge and its mirror image are equivalent: a step may have swapped them.
        points[:, 2] = np.abs(points[:, 2])
    return np.asarray(points)


def _repulsion(
    points: Points, charges: Points, excluded: Bool[np.ndarray, "n n"]
) -> tuple[float, Points]:
    """Half the energy of all points and charges, and its gradient with respect to the points.

    Half, because each pair occurs twice (charges are the points or their mirror images).
    """
    squared = np.maximum(2.0 - 2.0 * points @ charges.T, 1e-12)
    inverse = 1.0 / np.sqrt(squared)
    inverse[excluded] = 0.0
    cubed = inverse**3
    slope = cubed @ charges - cubed.sum(axis=1, keepdims=True) * points
    return float(inverse.sum() / 2.0), slope
