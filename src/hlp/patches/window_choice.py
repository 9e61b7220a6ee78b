"""Windows that the classifier can skip (`region.scan: fast`).

Three ways: every other window of the grid, windows on large planes such as a table, and one scan
for objects of nearly equal size. The reference, `region.scan: exact`, classifies all windows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hlp.geometry import back_project
from hlp.patches.holistic import Windows

_PLANES = 3  # a table, the floor, a wall
_MAX_DISTANCE = 0.010  # m from a plane, within the noise of a depth camera
_MIN_SHARE = 0.05  # of all windows that must lie on a plane
_MIN_NEIGHBOURS = 0.375  # of its neighbours on the plane: rejects thin slices of clutter
_MIN_CLOSE = 0.6  # of its windows within half the distance: a table has nearly all
_MIN_COSINE = 0.1  # of the viewing angle: the area of a plane seen edge-on is unknown
_TRIES = 200
_SAMPLED_POINTS = 300  # points on which the candidate planes are compared


@dataclass(frozen=True)
class SizeGroup:
    """Objects that share windows: the windows' metric size and the largest diameter (m)."""

    metric_size: float
    diameter: float


@dataclass(frozen=True)
class Plane:
    """A plane of the scene: the windows whose centres lie on it, and the area they cover (m²)."""

    windows: Bool[np.ndarray, "n"]
    area: float


def group_sizes(
    objects: Mapping[int, tuple[float, float]], max_ratio: float
) -> dict[int, SizeGroup]:
    """The group of each object id; `objects` gives metric sizes and diameters (m).

    Starting with the smallest, sizes that differ by at most a factor `max_ratio` share their
    geometric mean; with a ratio of 1 only equal sizes share windows.
    """
    groups: dict[int, SizeGroup] = {}
    waiting = sorted(objects, key=lambda object_id: objects[object_id])
    while waiting:
        smallest = objects[waiting[0]][0]
        members = [each for each in waiting if objects[each][0] <= smallest * max_ratio]
        largest = objects[members[-1]][0]
        shared = smallest if largest == smallest else float(np.sqrt(smallest * largest))
        diameter = max(objects[each][1] for each in members)
        groups |= dict.fromkeys(members, SizeGroup(shared, diameter))
        waiting = waiting[len(members) :]
    return groups


def find_planes(
    windows: Windows, camera_matrix: Float[np.ndarray, "3 3"], step: int
) -> list[Plane]:
    """Up to three planes with the most window centres; windows are `step` px apart."""
    points = back_project(windows.centers, windows.depths, camera_matrix)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    across = (step * windows.depths) ** 2 / (camera_matrix[0, 0] * camera_matrix[1, 1]) * rays[:, 2]
    left = np.ones(len(points), dtype=bool)
    planes: list[Plane] = []
    while len(planes) < _PLANES and left.sum() > max(3, _MIN_SHARE * len(points)):
        normal, offset = _largest_plane(points[left])
        away = np.abs(points @ normal - offset)
        found = left & (away < _MAX_DISTANCE)
        found &= _neighbour_share(windows.centers, found, step) >= _MIN_NEIGHBOURS
        enough = found.sum() > _MIN_SHARE * len(points)
        if not enough or (away[found] < _MAX_DISTANCE / 2).mean() < _MIN_CLOSE:
            break
        facing = np.maximum(np.abs(rays[found] @ normal), _MIN_COSINE)
        planes.append(Plane(found, float((across[found] / facing).sum())))
        left &= ~found
    return planes


def off_planes(planes: Sequence[Plane], count: int, diameter: float) -> Bool[np.ndarray, "n"]:
    """Which of `count` windows lie on no plane larger than the squared `diameter` (m).

    No face of the object can be that large, so the plane must be a support such as a table. Windows
    on parts of the object within a centimetre of the plane are lost as well. Not suitable for
    objects that thin, nor for parts packed so densely that their faces form one plane.
    """
    off = np.ones(count, dtype=bool)
    for plane in planes:
        if plane.area > diameter**2:
            off &= ~plane.windows
    return off


def checkerboard(centers: Float[np.ndarray, "n 2"], step: int) -> Bool[np.ndarray, "n"]:
    """Half of a grid of windows `step` px apart, chosen like the dark squares of a checkerboard."""
    return np.asarray((centers // step).sum(axis=1) % 2 == 0)


def _neighbour_share(
    centers: Float[np.ndarray, "n 2"], chosen: Bool[np.ndarray, "n"], step: int
) -> Float[np.ndarray, "n"]:
    """Share of chosen windows among the (at most eight) neighbours of each window."""
    x, y = (centers // step).astype(int).T + 1
    grid = np.zeros((2, y.max() + 2, x.max() + 2))
    grid[:, y, x] = chosen, np.ones(len(x))
    near = sum(grid[:, y + j, x + i] for j in (-1, 0, 1) for i in (-1, 0, 1))
    found, there = near - grid[:, y, x]
    return np.asarray(found / np.maximum(there, 1))


def _largest_plane(
    points: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "3"], float]:
    """Unit normal n and offset d (m) of the plane n·p = d with most points near it (RANSAC)."""
    corners = points[np.random.default_rng(0).integers(0, len(points), (_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    offsets = (normals * corners[:, 0]).sum(axis=1)
    sample = points[:: max(1, len(points) // _SAMPLED_POINTS)]
    near = (np.abs(sample @ normals.T - offsets) < _MAX_DISTANCE).sum(axis=0)
    near[np.linalg.norm(normals, axis=1) < 0.5] = 0  # three points on a line
    most = int(near.argmax())
    best = np.abs(points @ normals[most] - offsets[most]) < _MAX_DISTANCE
    for _ in range(2):
        middle = points[best].mean(axis=0)
        spread = points[best] - middle
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        best = np.abs((points - middle) @ normal) < _MAX_DISTANCE
    return normal, float(normal @ middle)
