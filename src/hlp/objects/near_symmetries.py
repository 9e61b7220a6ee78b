"""Rotations that leave an object's shape nearly as it is, and which of them its colours break.

Candidate axes are spread over the hemisphere and tested with turns by a half, third, … sixth in a
coarse grid of distances to the surface. The best are aligned by point-to-plane ICP and then tested
exactly. What passes is completed to a group; axes about which every turn passes are continuous.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hlp.arrays import Flags, Point, Points, Pose, Poses, Values
from hlp.geometry import inverse, rigid, rotation_distance, transform
from hlp.objects.meshes import hemisphere
from hlp.records import Mesh
from hlp.rendering.surface import sample_surface

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
_SAMPLES, _TESTED, _COARSE = 20_000, 1_500, 300
_CELLS, _MARGIN = 60, 6  # cells of the coarse grid along the diameter, and beside it
_WITHIN_95, _WITHIN_99 = 0.03, 0.06
_ALIGNING_STEPS = 8
_COLORS = 5  # every fifth sample is compared in colour
_SMOOTHED = 12  # samples whose colours are averaged: about 3 mm around a sample


@dataclass(frozen=True)
class NearSymmetries:
    """Motions (n, 4, 4) without the identity: `unbroken` by the colours, and `broken`."""

    unbroken: Poses
    broken: Poses


@dataclass(frozen=True)
class _Turn:
    """A turn by 2π / order about an axis (unit) through a point."""

    order: int
    axis: Point
    point: Point

    def by(self, angles: Values) -> Poses:
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
    kept = shape.keeps_colors(group)
    return NearSymmetries(group[kept], group[~kept])


def without(motions: Poses, known: Poses) -> Poses:
    """The motions that are turned by more than 10° against each of the known ones."""
    apart = rotation_distance(motions[:, None, :3, :3], known[None, :, :3, :3])
    return np.asarray(motions[(apart > _SAME_TURN).all(axis=1)])


def _find_turns(shape: ShapeDistance) -> list[_Turn]:
    """Turns of each order that pass, with axes at least 8° apart."""
    directions = hemisphere(_AXES)
    found: list[_Turn] = []
    for order in _ORDERS:
        angle = 2.0 * np.pi / order
        coarse = shape.coarse_distances(Rotation.from_rotvec(directions * angle).as_matrix())
        for axis in _best_apart(directions, coarse, _COARSE_LIMIT * shape.diameter):
            start = _Turn(order, axis, shape.center).by(np.array([angle]))[0]
            turn = _exact_turn(shape.aligned(start), order, shape.center)
            along = [t.order for t in found if turn and abs(turn.axis @ t.axis) > _SAME_AXIS]
            if turn is None or turn.order in along:
                continue
            if shape.are_alike(turn.by(np.array([angle]))):
                found.append(turn)
    return found


def _best_apart(directions: Points, costs: Values, limit: float) -> list[Point]:
    """The directions of least cost below a limit that are at least 15° apart."""
    chosen: list[Point] = []
    for index in np.argsort(costs, kind="stable"):
        if costs[index] > limit or len(chosen) == _CANDIDATES:
            break
        if all(abs(directions[index] @ other) < _APART for other in chosen):
            chosen.append(directions[index])
    return chosen


def _exact_turn(motion: Pose, order: int, center: Point) -> _Turn | None:
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
    flips = [turn for turn in turns if turn.order == 2 and abs(turn.axis @ axis.axis) < 0.2]
    flip = flips[0].by(np.array([np.pi])) if flips else np.empty((0, 4, 4))
    upside_down = (np.concatenate([np.eye(4)[None], steps])[:, None] @ flip).reshape(-1, 4, 4)
    motions = np.concatenate([steps, upside_down])
    if not colored:
        return NearSymmetries(motions, motions[:0])
    kept = shape.keeps_colors(motions)
    about, flipped = kept[: len(steps)], kept[len(steps) :]  # parts of `kept`
    if not about.all():
        about[:] = _subgroup(about)
    flipped &= np.concatenate([[True], about])[: len(flipped)] & about.any()
    return NearSymmetries(motions[kept], motions[~kept])


def _subgroup(kept: Flags) -> Flags:
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


def _completed(shape: ShapeDistance, motions: list[Pose]) -> Poses:
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


class ShapeDistance:
    """The surface of one object, sampled evenly.

    Tolerances are fractions of the diameter: for objects of 10 to 25 cm 3 % are 3 to 8 mm, which
    depth with errors of 2 to 5 mm and a pose fitted to it hardly show. That 99 % must lie within
    6 % makes a mug's handle, 4 % of its surface, count.
    """

    def __init__(self, mesh: Mesh, diameter: float) -> None:
        samples = sample_surface(mesh, _SAMPLES)
        self.diameter, self.center = diameter, samples.points.mean(axis=0)
        self._points, self._normals = samples.points, samples.normals
        self._tree = cKDTree(self._points)
        self._tested = self._points[:: _SAMPLES // _TESTED]
        distance, near = self._tree.query(self._points, k=_SMOOTHED)
        # Beyond the samples around a point, its plane says nothing about the surface.
        self._reach = 2.0 * float(np.median(distance[:, 1])) * np.sqrt(2.0)
        self._colors = samples.colors[near].mean(axis=1)
        self._fill_grid()

    def _fill_grid(self) -> None:
        side = _CELLS + 2 * _MARGIN
        self._cell = self.diameter / _CELLS
        self._corner = self.center - side / 2 * self._cell
        empty = np.ones((side, side, side), dtype=bool)
        empty[tuple(self._cells(self._points).T)] = False
        self._grid = distance_transform_edt(empty).astype(np.float32) * np.float32(self._cell)

    def _cells(self, points: Float[np.ndarray, "*b 3"]) -> Int[np.ndarray, "*b 3"]:
        cells = ((points - self._corner) / self._cell).astype(np.int32)
        return np.asarray(np.clip(cells, 0, _CELLS + 2 * _MARGIN - 1))

    def coarse_distances(self, rotations: Float[np.ndarray, "r 3 3"]) -> Values:
        """Mean distance (m) of the surface, turned about its centre, from itself, to 1 % or so."""
        points = self._points[:: _SAMPLES // _COARSE] - self.center
        turned = np.einsum("rij,pj->rpi", rotations, points) + self.center
        cells = self._cells(turned)
        found = self._grid[cells[..., 0], cells[..., 1], cells[..., 2]]
        return np.asarray(found.mean(axis=1), dtype=np.float64)

    def distances(self, motion: Pose) -> Values:
        """Distances (m) of the moved surface from the surface, and of the surface from the moved.

        Near a sample they are those to its plane.
        """
        found = []
        for direction in (motion, inverse(motion)):
            moved = transform(direction, self._tested)
            distance, nearest = self._tree.query(moved)
            offset = moved - self._points[nearest]
            across = np.abs(np.einsum("ij,ij->i", offset, self._normals[nearest]))
            along = np.sqrt(np.maximum(distance**2 - across**2, 0.0))
            found.append(np.where(along < self._reach, across, distance))
        return np.concatenate(found)

    def are_alike(self, motions: Poses) -> bool:
        """Whether all motions leave 95 % of the surface within 3 % of the diameter, 99 % in 6 %."""
        for motion in motions:
            most, nearly_all = np.quantile(self.distances(motion), [0.95, 0.99]) / self.diameter
            if most > _WITHIN_95 or nearly_all > _WITHIN_99:
                return False
        return True

    def aligned(self, motion: Pose) -> Pose:
        """The motion that maps the surface best onto itself near a given one (point-to-plane ICP).

        The farthest fifth of the points is left out of each step.
        """
        points = self._tested[::2]
        for _ in range(_ALIGNING_STEPS):
            moved = transform(motion, points)
            distance, nearest = self._tree.query(moved)
            normals = self._normals[nearest]
            limit = max(float(np.quantile(distance, 0.8)), 0.005 * self.diameter)
            used = (distance <= limit)[:, None]
            residual = ((self._points[nearest] - moved) * normals).sum(axis=1)
            rows = np.concatenate([np.cross(moved - self.center, normals), normals], axis=1) * used
            # A little damping, because surfaces of revolution slide along themselves.
            damping = 1e-9 * len(points) * np.diag([self.diameter**2] * 3 + [1.0] * 3)
            step = np.linalg.solve(rows.T @ rows + damping, rows.T @ residual)
            turn = Rotation.from_rotvec(step[:3]).as_matrix()
            motion = rigid(turn, step[3:] + self.center - turn @ self.center) @ motion
        return motion

    def keeps_colors(self, motions: Poses) -> Flags:
        """Whether the smoothed colours differ little after each motion."""
        found = [self._tree.query(transform(each, self._points[::_COLORS]))[1] for each in motions]
        apart = [self._colors[nearest] - self._colors[::_COLORS] for nearest in found]
        return np.array([np.sqrt(np.mean(each**2)) <= MAX_COLOR_DIFFERENCE for each in apart], bool)
