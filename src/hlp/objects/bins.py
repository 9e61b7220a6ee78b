"""Convex shapes with flat faces, and the walls of a bin made of them."""

import numpy as np
from jaxtyping import Float

from hlp.arrays import Point, Points
from hlp.records import Mesh

CUBE = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
"""Corners of a cube."""


def hull_mesh(points: Points, color: np.ndarray) -> Mesh:
    """The convex hull of points (m) in one colour, its faces flat."""
    from scipy.spatial import ConvexHull  # slow to import

    hull = ConvexHull(points)
    vertices = points[hull.simplices].reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    normals = np.repeat(hull.equations[:, :3], 3, axis=0)
    return Mesh(vertices, faces, np.tile(color, (len(vertices), 1)), normals)


def box_walls(
    reach: Float[np.ndarray, "2 2"], height: float, thickness: float, color: np.ndarray
) -> list[tuple[Mesh, Point]]:
    """Four walls that stand around the origin on z = 0, and where the middle of each is (m).

    `reach` is the distance of the inner sides, along both axes to both sides.
    """
    walls = []
    for axis, side in np.ndindex(2, 2):
        across, sign = 1 - axis, 1.0 - 2.0 * side
        size, middle = np.full(3, thickness), np.zeros(3)
        size[across], size[2] = float(reach[across].sum()), height
        middle[axis] = sign * (reach[axis, side] + thickness / 2)
        middle[across] = (reach[across, 0] - reach[across, 1]) / 2
        middle[2] = height / 2
        walls.append((hull_mesh(CUBE * size / 2, color), middle))
    return walls
