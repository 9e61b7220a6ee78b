"""Rotations that leave an object's shape nearly as it is, and which of them its colours break.

Candidate axes are spread over the hemisphere and tested with turns by a half, third, … sixth in a
coarse grid of distances to the surface. The best are aligned by point-to-plane ICP and then tested
exactly. What passes is completed to a group; axes about which every turn passes are continuous.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid, rotation_distance
from hlp.objects.shape_distance import ShapeDistance
from hlp.records import Mesh

CONTINUOUS_STEPS = 72
"""Turns by 5° stand for a continuous axis: at its rim they are half a pixel or so apart."""
MAX_COLOR_DIFFERENCE = 25.0
"""Root mean square difference of smoothed colours (of 255) from which colours break a symmetry.

Measured: bowl, foam brick, wood block, clamps, eggbox and glue differ by 7 to 24 after the turns
that map their shapes onto themselves, printed boxes, cans and bottles by 29 and more.
"""
_ORDERS = (2, 3, 4, 5, 6)
_AXES = 1000  # 4.5° apart
_CANDIDATES, _APART = 6, np.cos(np.radians(15.0))  # aligned axes for each order
_COARSE_LIMIT = 0.05  # of the diameter; mean distance before the alignment
_SAME_AXIS, _SAME_TURN = np.cos(np.radians(8.0)), np.radians(10.0)
_PROBES = np.radians([17.0, 40.0, 77.0, 101.0, 143.0])  # no multiples of a symmetric turn
_LARGEST_GROUP = 60  # rotations of an icosahedron


@dataclass(frozen=True)
class NearSymmetries:
    """Motions (n, 4, 4) without the identity: `unbroken` by the colours, and `broken`."""

    unbroken: Float[np.ndarray, "n 4 4"]
    broken: Float[np.ndarray, "k 4 4"]


@dataclass(frozen=True)
class _Turn:
    """A turn by 2π / order about an axis (unit) through a point."""

    order: int
    axis: Float[np.ndarray, "3"]
    point: Float[np.ndarray, "3"]

    def by(self, angles: Float[np.ndarray, "a"]) -> Float[np.ndarray, "a 4 4"]:
        """Motions of turns by angles (rad)."""
        turns = Rotation.from_rotvec(angles[:, None] * self.axis).as_matrix()
        return rigid(turns, self.point - turns @ self.point)


def find_near_symmetries(mesh: Mesh, diameter: float) -> NearSymmetries:
    """The near-symmetries of a mesh; `diameter` (m) is the largest distance between two vertices.

    A motion passes if 95 % of the surface lies within 3 % of the diameter of the moved surface and
    99 % within 6 %, both ways (`ShapeDistance.is_alike`). Takes 1 to 2 s.
    """
    shape = ShapeDistance(mesh, diameter)
    turns = _find_turns(shape)
    axes = [turn for turn in turns if shape.are_alike(turn.by(_PROBES))]
    if axes:
        axis = min(axes, key=lambda turn: float(shape.distances(turn.by(_PROBES[:1])[0]).mean()))
        return _about_continuous_axis(shape, axis, turns, mesh.colored)
    group = _completed(shape, [turn.by(np.array([2 * np.pi / turn.order]))[0] for turn in turns])
    if not mesh.colored:
        return NearSymmetries(group, group[:0])
    broken = np.array([shape.color_difference(each) > MAX_COLOR_DIFFERENCE for each in group], bool)
    return NearSymmetries(group[~broken], group[broken])


def without(
    motions: Float[np.ndarray, "n 4 4"], known: Float[np.ndarray, "k 4 4"]
) -> Float[np.ndarray, "m 4 4"]:
    """The motions that are turned by more than 10° against each of the known ones."""
    apart = rotation_distance(motions[:, None, :3, :3], known[None, :, :3, :3])
    return np.asarray(motions[(apart > _SAME_TURN).all(axis=1)])


def _find_turns(shape: ShapeDistance) -> list[_Turn]:
    """Turns of each order that pass, with axes at least 8° apart."""
    directions = _hemisphere(_AXES)
    found: list[_Turn] = []
    for order in _ORDERS:
        angle = 2.0 * np.pi / order
        coarse = shape.coarse_distances(Rotation.from_rotvec(directions * angle).as_matrix())
        for axis in _best_apart(directions, coarse, _COARSE_LIMIT * shape.diameter):
            start = _Turn(order, axis, shape.center).by(np.array([angle]))[0]
            turn = _exact_turn(shape.aligned(start), order, shape.center)
            if turn is None or any(_same(turn, other) for other in found):
                continue
            if shape.are_alike(turn.by(np.array([angle]))):
                found.append(turn)
    return found


def _same(turn: _Turn, other: _Turn) -> bool:
    return turn.order == other.order and abs(turn.axis @ other.axis) > _SAME_AXIS


def _best_apart(
    directions: Float[np.ndarray, "a 3"], costs: Float[np.ndarray, "a"], limit: float
) -> list[Float[np.ndarray, "3"]]:
    """The directions of least cost below a limit that are at least 15° apart."""
    chosen: list[Float[np.ndarray, "3"]] = []
    for index in np.argsort(costs, kind="stable"):
        if costs[index] > limit or len(chosen) == _CANDIDATES:
            break
        if all(abs(directions[index] @ other) < _APART for other in chosen):
            chosen.append(directions[index])
    return chosen


def _exact_turn(
    motion: Float[np.ndarray, "4 4"], order: int, center: Float[np.ndarray, "3"]
) -> _Turn | None:
    """The turn by exactly 2π / order that is nearest to a motion; None if that is not near."""
    rotation = motion[:3, :3]
    vector = Rotation.from_matrix(rotation).as_rotvec()
    angle = float(np.linalg.norm(vector))
    if abs(angle - 2.0 * np.pi / order) > _SAME_TURN:
        return None
    axis = vector / angle
    # The point of the axis that is nearest to the centre.
    left = np.eye(3) - rotation + np.outer(axis, axis)
    point = np.linalg.solve(left, motion[:3, 3] + axis * (axis @ center))
    return _Turn(order, axis, point)


def _about_continuous_axis(
    shape: ShapeDistance, axis: _Turn, turns: list[_Turn], colored: bool
) -> NearSymmetries:
    """All turns about an axis in steps, and the same turned upside down if the shape allows it.

    Colours that break some turns may leave those by a half, third, …; neighbours of the identity,
    which hardly move the colours, are no symmetries then.
    """
    angles = np.arange(1, CONTINUOUS_STEPS) * (2.0 * np.pi / CONTINUOUS_STEPS)
    steps = axis.by(angles)
    flips = [each for each in turns if each.order == 2 and abs(each.axis @ axis.axis) < 0.2]
    flip = flips[0].by(np.array([np.pi])) if flips else np.empty((0, 4, 4))
    upside_down = (np.concatenate([np.eye(4)[None], steps])[:, None] @ flip).reshape(-1, 4, 4)
    if not colored:
        return NearSymmetries(np.concatenate([steps, upside_down]), np.empty((0, 4, 4)))
    kept = np.array([shape.color_difference(each) for each in steps]) <= MAX_COLOR_DIFFERENCE
    if not kept.all():
        kept = _subgroup(kept)
    flip_kept = np.zeros(len(upside_down), bool)
    if len(flip):
        unchanged = [shape.color_difference(each) <= MAX_COLOR_DIFFERENCE for each in upside_down]
        flip_kept[:] = np.array(unchanged) & np.concatenate([[True], kept]) if kept.any() else False
    return NearSymmetries(
        np.concatenate([steps[kept], upside_down[flip_kept]]),
        np.concatenate([steps[~kept], upside_down[~flip_kept]]),
    )


def _subgroup(kept: Bool[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Of turns by 1, 2, … steps, those of the largest subgroup that is kept as a whole."""
    count = len(kept) + 1
    for order in (6, 5, 4, 3, 2):
        if count % order == 0:
            members = np.arange(1, order) * (count // order) - 1
            if kept[members].all():
                chosen = np.zeros(len(kept), bool)
                chosen[members] = True
                return chosen
    return np.zeros(len(kept), bool)


def _completed(
    shape: ShapeDistance, motions: list[Float[np.ndarray, "4 4"]]
) -> Float[np.ndarray, "n 4 4"]:
    """The motions with all their products that pass, without the identity."""
    group = [np.eye(4), *motions]
    grown = True
    while grown and len(group) < _LARGEST_GROUP:
        grown = False
        for first, second in itertools.product(group[1:], repeat=2):
            product = first @ second
            nearest = rotation_distance(np.stack(group)[:, :3, :3], product[:3, :3]).min()
            if nearest > _SAME_TURN and shape.are_alike(product[None]):
                group.append(product)
                grown = True
    return np.stack(group)[1:] if len(group) > 1 else np.empty((0, 4, 4))


def _hemisphere(count: int) -> Float[np.ndarray, "n 3"]:
    """Directions spread evenly over the upper hemisphere (Fibonacci's spiral)."""
    index = np.arange(count) + 0.5
    z = index / count
    angle = index * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
