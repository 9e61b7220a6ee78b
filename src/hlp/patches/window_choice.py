"""Which windows the classifier need not see: every other, on a large plane, of a size seen already.

Fewer windows than the reference, `region.scan: exact`, has; DESIGN, section 7, "Windows".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hlp.geometry import back_project
from hlp.patches.holistic import Windows

_PLANES = 3  # a table, the floor, a wall
_DISTANCE = 0.010  # m from a plane within which a depth may be its own: a depth camera's noise
_LEAST_SHARE = 0.05  # of the windows lie on a plane, or it is none
_LEAST_AROUND = 0.375  # of the windows next to one are on it too: a slice through clutter is narrow
_LEAST_NEAR = 0.6  # of them at half the distance: about all of a table, half of a slice
_LEAST_FACING = 0.1  # cosine; a plane seen from its edge has no known area
_TRIES = 200
_ENOUGH = 300  # points that the tries are judged by


@dataclass(frozen=True)
class SizeGroup:
    """Objects whose windows are made once: the metric size (m) used, the largest diameter (m)."""

    metric_size: float
    diameter: float


@dataclass(frozen=True)
class Plane:
    """A plane of the scene: the windows whose centre lies on it, and their area on it (m²)."""

    windows: Bool[np.ndarray, "n"]
    area: float


def group_sizes(objects: Mapping[int, tuple[float, float]], apart: float) -> dict[int, SizeGroup]:
    """A group for each object id, of its metric size and diameter (m).

    From the smallest size on, sizes up to a factor `apart` from each other share the one in their
    middle; with 1 only equal sizes do.
    """
    groups: dict[int, SizeGroup] = {}
    waiting = sorted(objects, key=lambda object_id: objects[object_id])
    while waiting:
        least = objects[waiting[0]][0]
        members = [each for each in waiting if objects[each][0] <= least * apart]
        most = objects[members[-1]][0]
        middle = least if most == least else float(np.sqrt(least * most))
        diameter = max(objects[each][1] for each in members)
        groups |= dict.fromkeys(members, SizeGroup(middle, diameter))
        waiting = waiting[len(members) :]
    return groups


def find_planes(
    windows: Windows, camera_matrix: Float[np.ndarray, "3 3"], step: int
) -> list[Plane]:
    """The three planes that most windows' centres lie on, or fewer; `step` px between windows."""
    points = back_project(windows.centers, windows.depths, camera_matrix)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    across = (step * windows.depths) ** 2 / (camera_matrix[0, 0] * camera_matrix[1, 1]) * rays[:, 2]
    left = np.ones(len(points), dtype=bool)
    planes: list[Plane] = []
    while len(planes) < _PLANES and left.sum() > max(3, _LEAST_SHARE * len(points)):
        normal, offset = _largest_plane(points[left])
        away = np.abs(points @ normal - offset)
        found = left & (away < _DISTANCE)
        found &= _around(windows.centers, found, step) >= _LEAST_AROUND
        enough = found.sum() > _LEAST_SHARE * len(points)
        if not enough or (away[found] < _DISTANCE / 2).mean() < _LEAST_NEAR:
            break
        facing = np.maximum(np.abs(rays[found] @ normal), _LEAST_FACING)
        planes.append(Plane(found, float((across[found] / facing).sum())))
        left &= ~found
    return planes


def off_planes(planes: Sequence[Plane], count: int, diameter: float) -> Bool[np.ndarray, "n"]:
    """Which of `count` windows lie on no plane that is larger than an object of that diameter (m).

    No face of the object has a squared diameter's area, so such a plane is what objects stand on.
    Points of an object within a centimetre of it are lost too: this is not for objects as thin as
    that, nor for parts packed so tightly that their faces make one plane.
    """
    off = np.ones(count, dtype=bool)
    for plane in planes:
        if plane.area > diameter**2:
            off &= ~plane.windows
    return off


def checkerboard(centers: Float[np.ndarray, "n 2"], step: int) -> Bool[np.ndarray, "n"]:
    """Which windows lie on the dark fields of a chessboard, half of a grid of that step (px)."""
    return np.asarray((centers // step).sum(axis=1) % 2 == 0)


def _around(
    centers: Float[np.ndarray, "n 2"], chosen: Bool[np.ndarray, "n"], step: int
) -> Float[np.ndarray, "n"]:
    """Share of the chosen among the (at most eight) windows next to each."""
    x, y = (centers // step).astype(int).T + 1
    grid = np.zeros((2, y.max() + 2, x.max() + 2))
    grid[:, y, x] = chosen, np.ones(len(x))
    near = sum(grid[:, y + j, x + i] for j in (-1, 0, 1) for i in (-1, 0, 1))
    found, there = near - grid[:, y, x]
    return np.asarray(found / np.maximum(there, 1))


def _largest_plane(
    points: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "3"], float]:
    """Unit normal n and offset d of the plane n·p = d that most points are near (RANSAC)."""
    corners = points[np.random.default_rng(0).integers(0, len(points), (_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    offsets = (normals * corners[:, 0]).sum(axis=1)
    some = points[:: max(1, len(points) // _ENOUGH)]
    near = (np.abs(some @ normals.T - offsets) < _DISTANCE).sum(axis=0)
    near[np.linalg.norm(normals, axis=1) < 0.5] = 0  # three points on a line
    most = int(near.argmax())
    best = np.abs(points @ normals[most] - offsets[most]) < _DISTANCE
    for _ in range(2):
        middle = points[best].mean(axis=0)
        spread = points[best] - middle
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        best = np.abs((points - middle) @ normal) < _DISTANCE
    return normal, float(normal @ middle)
