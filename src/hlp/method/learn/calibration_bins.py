"""Places and meshes in the scenes of score calibration: bins, and more of the object in them."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from hlp.arrays import Pose, Vector
from hlp.geometry import rigid, transform
from hlp.objects.shapes import box_walls
from hlp.records import Mesh, ObjectModel

_ROOM = (0.8, 3.0)  # from the middle to a wall, in diameters
_HEIGHT = (0.2, 1.0)  # of a wall, in diameters
_THICK = 0.02  # m
_COPIES = (1, 6)
_FACING = 0.3  # cosine between a plane's normal and the line of sight, at least

Plane = tuple[Vector, float]
"""Normal n, which faces the camera, and offset d: the points with n·x = d (m)."""


def center_of(model: ObjectModel, pose: Pose) -> Vector:
    """Where the object's centroid is in the camera's coordinates (m)."""
    return np.asarray(transform(pose, model.centroid[None])[0])


def resting_plane(model: ObjectModel, pose: Pose, rng: np.random.Generator) -> Plane | None:
    """A plane that the object lies on with a large face of its hull, where one faces the camera."""
    points = np.asarray(model.proxy.vertices, dtype=np.float64)
    try:
        hull = ConvexHull(points)
    except QhullError:  # it is flat
        return None
    corners = points[hull.simplices]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    up = -hull.equations[:, :3] @ pose[:3, :3].T
    center = center_of(model, pose)
    likely = np.linalg.norm(sides, axis=1) * (up @ -center > _FACING * np.linalg.norm(center))
    # Triangles of one face are many: all that point the same way count.
    areas = (up @ up.T > 1.0 - 1e-4) @ likely * (likely > 0.0)
    if not areas.any():
        return None
    normal = up[rng.choice(len(areas), p=areas**2 / np.sum(areas**2))]
    return normal, float((transform(pose, points) @ normal).min())


def bin_walls(
    model: ObjectModel, center: Vector, plane: Plane, rng: np.random.Generator
) -> list[tuple[Mesh, Pose]]:
    """Four walls of one colour that stand on the plane around a place."""
    normal, offset = plane
    frame = _upright(normal, rng)
    floor = center + (offset - center @ normal) * normal
    height = model.diameter * rng.uniform(*_HEIGHT)
    color = rng.uniform(10, 240, 3).astype(np.uint8)
    rooms = model.diameter * rng.uniform(*_ROOM, (2, 2))  # along both axes, to both sides
    walls = box_walls(rooms, height, _THICK, color)
    return [(wall, rigid(frame, floor + frame @ middle)) for wall, middle in walls]


def copies(
    mesh: Mesh, model: ObjectModel, pose: Pose, plane: Plane, rng: np.random.Generator
) -> list[tuple[Mesh, Pose]]:
    """The object some more times on the plane, turned about its normal, beside the first one."""
    normal, center, found = plane[0], center_of(model, pose), [(mesh, pose)]
    for _ in range(int(rng.integers(_COPIES[0], _COPIES[1] + 1))):
        turn = Rotation.from_rotvec(normal * rng.uniform(0.0, 2.0 * np.pi)).as_matrix()
        away = _upright(normal, rng)[:, 0] * model.diameter * rng.uniform(0.7, 2.0)
        apart = [np.linalg.norm(center + away - center_of(model, other)) for _, other in found]
        if min(apart) >= 0.7 * model.diameter:
            moved = turn @ pose[:3, :3]
            found.append((mesh, rigid(moved, center + away - moved @ model.centroid)))
    return found[1:]


def with_random_color(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """The mesh in one colour, if its own means nothing."""
    if mesh.colored:
        return mesh
    color = np.clip(rng.uniform(10, 230) + rng.normal(0.0, 45.0, 3), 5, 250)
    return replace(mesh, colors=np.full_like(mesh.colors, color.astype(np.uint8)))


def _upright(normal: Vector, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """Axes of which the third is the normal, turned about it at random."""
    first = np.cross(normal, rng.normal(size=3))
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first), normal], axis=1)
