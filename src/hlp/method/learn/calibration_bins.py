"""Places and meshes in the scenes of score calibration: bins, and more of the object in them."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from hlp.arrays import Pose, Vector
from hlp.geometry import rigid, transform
from hlp.objects.shapes import box_walls
from hlp.records import Mesh, ObjectModel

_ROOM = (0.8, 3.0)  # from the middle to a wall, in diameters
_HEIGHT = (0.2, 1.0)  # of a wall, in diameters
_THICK = 0.02  # m
_IN_ROW, _LACKING = 4, 0.15  # copies in a row, at most; share of places that are empty
_PACKED = 0.6  # share of scenes with copies that touch
_CLOSE, _APART = 0.04, 0.5  # gap beside packed copies and others, at most, of their size
_TILT = 0.3  # rad, standard deviation about each axis

Plane = tuple[Vector, float]
"""Normal n, which faces the camera, and offset d: the points with n·x = d (m)."""


def center_of(model: ObjectModel, pose: Pose) -> Vector:
    """Where the object's centroid is in the camera's coordinates (m)."""
    return np.asarray(transform(pose, model.centroid[None])[0])


def lying(model: ObjectModel, pose: Pose, rng: np.random.Generator) -> tuple[Pose, Plane]:
    """The pose, turned until a side of the object's box faces the camera; the plane it lies on.

    It is one of the sides that are seen at `pose`, a large one rather than a small one.
    """
    center, (x, y, z) = center_of(model, pose), np.ptp(model.proxy.vertices, axis=0)
    view = -center / np.linalg.norm(center)
    up = Rotation.from_rotvec(rng.normal(0.0, _TILT, 3)).apply(view)
    areas = np.array([y * z, x * z, x * y])
    axis = int(rng.choice(3, p=areas / areas.sum()))
    side = pose[:3, axis] * np.copysign(1.0, pose[:3, axis] @ view)
    turn, _ = Rotation.align_vectors(up[None], side[None])
    rotation = turn.as_matrix() @ pose[:3, :3]
    pose = rigid(rotation, center - rotation @ model.centroid)
    return pose, (up, float((transform(pose, model.proxy.vertices) @ up).min()))


def bin_walls(
    model: ObjectModel, center: Vector, plane: Plane, rng: np.random.Generator
) -> list[tuple[Mesh, Pose]]:
    """Four walls of one colour that stand on the plane around a place."""
    normal, offset = plane
    along = np.cross(normal, rng.normal(size=3))
    along /= np.linalg.norm(along)
    frame = np.stack([along, np.cross(normal, along), normal], axis=1)
    floor = center + (offset - center @ normal) * normal
    height = model.diameter * rng.uniform(*_HEIGHT)
    color = rng.uniform(10, 240, 3).astype(np.uint8)
    rooms = model.diameter * rng.uniform(*_ROOM, (2, 2))  # along both axes, to both sides
    walls = box_walls(rooms, height, _THICK, color)
    return [(wall, rigid(frame, floor + frame @ middle)) for wall, middle in walls]


def copies(
    mesh: Mesh, model: ObjectModel, pose: Pose, plane: Plane, rng: np.random.Generator
) -> list[tuple[Mesh, Pose]]:
    """The object some more times on the plane: packed in rows, or apart, each turned at random."""
    rotation, center, found = pose[:3, :3], center_of(model, pose), []
    along = np.argsort(np.abs(rotation.T @ plane[0]))[:2]  # the model's axes in the plane
    sizes, gap, turn = np.full(2, model.diameter), _APART, np.pi
    if rng.random() < _PACKED:
        sizes, gap = np.ptp(mesh.vertices, axis=0)[along], _CLOSE
        turn = gap * float(sizes.min() / sizes.max())
    pitch = sizes * (1.0 + rng.uniform(0.0, gap, 2))
    counts = rng.integers(1, _IN_ROW, 2, endpoint=True)
    own = rng.integers(0, counts)
    for place in np.ndindex(*counts):
        steps = np.array(place) - own
        if not steps.any() or rng.random() < _LACKING:
            continue
        away = rotation[:, along] @ (steps * pitch)
        turned = Rotation.from_rotvec(plane[0] * rng.uniform(-turn, turn)).as_matrix() @ rotation
        found.append((mesh, rigid(turned, center + away - turned @ model.centroid)))
    return found


def with_random_color(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """The mesh in one colour, if its own means nothing."""
    if mesh.colored:
        return mesh
    color = np.clip(rng.uniform(10, 230) + rng.normal(0.0, 45.0, 3), 5, 250)
    return replace(mesh, colors=np.full_like(mesh.colors, color.astype(np.uint8)))
