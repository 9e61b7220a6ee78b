"""Which windows the classifier need not see: on a large plane, or near in size to another's.

Fewer windows than the reference, `region.scan: exact`, has; DESIGN, section 7, "Windows".
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hlp.geometry import back_project
from hlp.patches.holistic import Windows

_PLANES = 2  # a table and the floor, or a wall
_DISTANCE = 0.010  # m from a plane within which a depth may be its own: a depth camera's noise
_LEAST_SHARE = 0.1  # of the windows lie on a plane, or it is none
_LEAST_AROUND = 0.5  # of the windows next to one are on it too: a slice through clutter is narrow
_TRIES = 200
_LEAST_AREA = 2.0  # squared diameters: more than twice what a face of the object can have
_LEAST_FACING = 0.1  # cosine; a plane seen from its edge has no known area


@dataclass(frozen=True)
class SizeGroup:
    """Objects whose windows are made once: the metric size (m) used, the largest diameter (m)."""

    metric_size: float
    diameter: float


def group_sizes(
    objects: Mapping[int, tuple[float, float]], scale_jitter: float
) -> dict[int, SizeGroup]:
    """A group for each object id, of its metric size and diameter (m).

    From the smallest size on, sizes up to (1 + jitter)² apart share the one in their middle: then
    every object is seen within the jitter of scale that the classifier was trained with.
    """
    groups: dict[int, SizeGroup] = {}
    waiting = sorted(objects, key=lambda object_id: objects[object_id])
    while waiting:
        least = objects[waiting[0]][0]
        limit = least * (1 + scale_jitter) ** 2
        members = [each for each in waiting if objects[each][0] <= limit]
        most = objects[members[-1]][0]
        middle = least if most == least else float(np.sqrt(least * most))
        diameter = max(objects[each][1] for each in members)
        groups |= dict.fromkeys(members, SizeGroup(middle, diameter))
        waiting = waiting[len(members) :]
    return groups


def off_planes(
    windows: Windows,
    camera_matrix: Float[np.ndarray, "3 3"],
    step: int,
    diameter: float,
) -> Bool[np.ndarray, "n"]:
    """Windows whose centre lies on none of the scene's large planes.

    The two largest planes through the windows' centres count, where they are much larger than an
    object of that `diameter`: such a plane is what objects stand on. An object's points within a
    centimetre of it are lost too, so this is not for objects as thin as that, nor for parts that
    are packed so tightly that their faces make one plane.
    """
    points = back_project(windows.centers, windows.depths, camera_matrix)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    across = (step * windows.depths) ** 2 / (camera_matrix[0, 0] * camera_matrix[1, 1]) * rays[:, 2]
    off = np.ones(len(points), dtype=bool)
    for _ in range(_PLANES):
        if off.sum() <= max(3, _LEAST_SHARE * len(points)):
            break
        normal, offset = _largest_plane(points[off])
        on_plane = off & (np.abs(points @ normal - offset) < _DISTANCE)
        on_plane &= _around(windows.centers, on_plane, step) >= _LEAST_AROUND
        facing = np.maximum(np.abs(rays[on_plane] @ normal), _LEAST_FACING)
        large = (across[on_plane] / facing).sum() > _LEAST_AREA * diameter**2
        if on_plane.sum() <= _LEAST_SHARE * len(points) or not large:
            break
        off &= ~on_plane
    return off


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
    near = np.abs(points @ normals.T - offsets) < _DISTANCE
    near[:, np.linalg.norm(normals, axis=1) < 0.5] = False  # three points on a line
    best = near[:, near.sum(axis=0).argmax()]
    for _ in range(2):
        middle = points[best].mean(axis=0)
        spread = points[best] - middle
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        best = np.abs((points - middle) @ normal) < _DISTANCE
    return normal, float(normal @ middle)
