"""Turns after which an object looks much alike: about its axis, or half a turn of its box.

Of a mug whose handle is hidden or small, the swarm ends at any turn; of a flat part, it ends upside
down or end for end. It does not turn so far, so turns are compared.
"""

import numpy as np
from jaxtyping import Float

from hlp.arrays import Point, Points, Poses
from hlp.geometry import rigid, rotation_distance, rotation_matrices, transform
from hlp.records import ObjectModel
from hlp.rendering.surface import sample_surface

_STEPS = 36  # turns by 10°
_SAMPLES, _TESTED = 2000, 8  # of the surface; every eighth is tested
_PROBES = (4, 10, 17, 23, 31)  # steps; no multiples of a part of a turn
_WITHIN, _ALIKE = 0.04, 0.9  # nine tenths of the surface lie within 4 % of the diameter (D)
_ROUNDS = 15
_LEAST = 0.01  # of a normal's moment about an axis (in half diameters): noise
_SAME_TURN = np.radians(15.0)
_HALF_TURNS = np.stack([np.diag(signs) for signs in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1))]) * 1.0


def turns_about_axis(model: ObjectModel) -> Poses:
    """Turns (n, 4, 4) of an object about its axis, the identity first.

    None but the identity where the object is not nearly of revolution, or has symmetries: colours
    tell which of its poses is right, or nothing does.
    """
    identity = np.eye(4)[None]
    if len(model.symmetries) > 1 or len(model.near_symmetries) > 0:
        return identity
    samples = sample_surface(model.proxy, _SAMPLES)
    half, center = model.diameter / 2.0, model.centroid
    axis, moment = _axis_that_normals_meet((samples.points - center) / half, samples.normals)
    turns = _turns(axis, center + half * np.cross(axis, moment))
    tested = samples.points[::_TESTED]
    for turn in turns[[*_PROBES]]:
        moved = transform(turn, tested)
        nearest = np.linalg.norm(moved[:, None] - samples.points, axis=-1).min(axis=1)
        if np.mean(nearest <= _WITHIN * model.diameter) < _ALIKE:
            return identity
    return turns


def half_turns(model: ObjectModel) -> Poses:
    """Half turns (n, 4, 4) about the axes of the bounding box, but for an object's symmetries.

    None of an object with colours, which tell more (`ObjectModel.near_symmetries`).
    """
    if model.mesh.colored:
        return np.zeros((0, 4, 4))
    turns = told_apart(_HALF_TURNS, model)
    return rigid(turns, model.centroid - turns @ model.centroid)


def told_apart(turns: Float[np.ndarray, "n 3 3"], model: ObjectModel) -> Float[np.ndarray, "k 3 3"]:
    """Those of some turns that are no symmetries of an object."""
    apart = rotation_distance(turns[:, None], model.symmetries[None, :, :3, :3])
    return np.asarray(turns[apart.min(axis=1) > _SAME_TURN])


def _turns(axis: Point, through: Point) -> Poses:
    """Turns about an axis (unit) through a point."""
    halves = np.arange(_STEPS)[:, None] * (np.pi / _STEPS)
    rotations = rotation_matrices(np.hstack([np.sin(halves) * axis, np.cos(halves)]))
    return rigid(rotations, through - rotations @ through)


def _axis_that_normals_meet(points: Points, normals: Points) -> tuple[Point, Point]:
    """The axis (unit) that most lines through points along their normals meet, and its moment.

    Those of a surface of revolution all meet it: w·(p × n) + v·n = 0 (Pottmann and Randrup,
    Rotational and helical surface approximation, Computing 60, 1998). Of three starts the one that
    most lines end near; far lines hardly count (iteratively reweighted least squares).
    """
    lines = np.concatenate([np.cross(points, normals), normals], axis=1)
    best, least = np.zeros(6), np.inf
    for start in np.eye(6)[:3]:
        found = start
        for _ in range(_ROUNDS):
            away = np.abs(lines @ found)
            weights = (1.0 + np.square(away / max(float(np.median(away)), _LEAST))) ** -2
            found = _least_motion((lines * weights[:, None]).T @ lines)
        middle = float(np.median(np.abs(lines @ found)))
        if middle < least:
            best, least = found, middle
    return best[:3], best[3:]


def _least_motion(products: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6"]:
    """The rotation about a unit axis, and its moment, of least sum of squares."""
    onto = -np.linalg.pinv(products[3:, 3:]) @ products[3:, :3]
    _, vectors = np.linalg.eigh(products[:3, :3] + products[:3, 3:] @ onto)
    return np.concatenate([vectors[:, 0], onto @ vectors[:, 0]])
