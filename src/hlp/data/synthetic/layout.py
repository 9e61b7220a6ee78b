"""Layout of a demo scene: objects, clutter and occluders on a table, camera and light.

World coordinates are in metres, z up; the origin is the middle of the table's top.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hlp.data.synthetic.shapes import (
    Color,
    cylinder,
    ellipsoid,
    lathe,
    painted,
    rounded_box,
    tube,
)
from hlp.geometry import inverse, rigid
from hlp.records import Mesh, ObjectModel
from hlp.rendering.light import Light

GAP = 0.004
"""Least distance (m) between the circles that items occupy on the table."""
_SPACING = 0.007
_TRIES = 60


@dataclass(frozen=True)
class Item:
    """A shape on the table inside a circle of `center` and `radius` (m), seen from above.

    `object_id` is 0 for clutter. `coarse` is a mesh of fewer triangles, from which its shadow is
    rendered.
    """

    object_id: int
    mesh: Mesh
    coarse: Mesh
    pose_world_obj: Float[np.ndarray, "4 4"]
    center: Float[np.ndarray, "2"]
    radius: float


@dataclass(frozen=True)
class UprightShape:
    """A shape whose lowest point is at z = 0, before it has a position on the table."""

    object_id: int
    mesh: Mesh
    coarse: Mesh
    rotation: Float[np.ndarray, "3 3"]
    offset: Float[np.ndarray, "3"]
    radius: float

    def at(self, place: Float[np.ndarray, "2"]) -> Item:
        """The item with its circle's centre at a position (x, y) on the table (m)."""
        pose = rigid(self.rotation, self.offset + np.array([*place, 0.0]))
        return Item(self.object_id, self.mesh, self.coarse, pose, place, self.radius)


def set_upright(
    object_id: int, mesh: Mesh, coarse: Mesh, tilt: float, rng: np.random.Generator
) -> UprightShape:
    """Rotate a mesh by a random yaw and tilt it by up to `tilt` (rad) in a random direction."""
    lean = rng.uniform(0.0, tilt)
    direction = rng.uniform(0.0, 2 * np.pi)
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 2 * np.pi)])
    rotation = (Rotation.from_rotvec(lean * axis) * yaw).as_matrix()
    points = mesh.vertices @ rotation.T
    low, high = points.min(axis=0), points.max(axis=0)
    offset = -np.array([*(low + high)[:2] / 2, low[2]])
    radius = float(np.linalg.norm((points + offset)[:, :2], axis=1).max())
    return UprightShape(object_id, mesh, coarse, rotation, offset, radius)


def place_targets(
    models: Sequence[ObjectModel], tilt: float, rng: np.random.Generator
) -> list[Item]:
    """Place the objects close together around the table's middle without contact."""
    items: list[Item] = []
    for model in models:
        upright = set_upright(model.object_id, model.mesh, model.proxy, tilt, rng)
        items.append(upright.at(_free_position(upright.radius, items, rng)))
    return items


def place_clutter(
    count: int,
    items: Sequence[Item],
    eye: Float[np.ndarray, "3"],
    rng: np.random.Generator,
) -> list[Item]:
    """`count` random shapes. If there are targets, two of three occlude one, seen from the `eye`.

    Half of these are tall shapes, half are trees whose crown is in front of the target.
    """
    everything = list(items)
    targets = [item for item in items if item.object_id]
    for number in range(count):
        item = None
        if targets and number % 3 < 2:
            target = targets[int(rng.integers(len(targets)))]
            item = _occluder(number % 3 == 1, target, everything, eye, rng)
        if item is None:
            mesh = random_shape(rng)
            upright = set_upright(0, mesh, mesh, 0.0, rng)
            item = upright.at(_free_position(upright.radius, everything, rng))
        everything.append(item)
    return everything[len(items) :]


def _occluder(
    tree: bool,
    target: Item,
    items: Sequence[Item],
    eye: Float[np.ndarray, "3"],
    rng: np.random.Generator,
) -> Item | None:
    """A tall shape or a tree between a target and the eye; None if there is no space."""
    crown = rng.uniform(0.02, 0.045)
    mesh = random_shape(rng, least_height=0.12)
    radius = crown if tree else set_upright(0, mesh, mesh, 0.0, rng).radius
    middle = target.pose_world_obj[2, 3]
    toward_eye = eye - np.array([*target.center, middle])
    place = _position_in_front(radius, target, items, toward_eye[:2], rng)
    if place is None:
        return None
    if tree:
        rise = toward_eye[2] / np.linalg.norm(toward_eye[:2])
        sight = middle + float(np.linalg.norm(place - target.center)) * rise
        height = sight + rng.uniform(-0.5, 0.5) * middle
        mesh = toy_tree(crown, float(min(height, 0.30)), rng)
    return set_upright(0, mesh, mesh, 0.0, rng).at(place)


def _free_position(
    radius: float, items: Sequence[Item], rng: np.random.Generator
) -> Float[np.ndarray, "2"]:
    """A random free position in a disc that grows until it has one."""
    disc_radius = 0.12
    while True:
        angle = rng.uniform(0.0, 2 * np.pi, _TRIES)
        distance = disc_radius * np.sqrt(rng.uniform(size=_TRIES))
        places = distance[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        place = _first_free(places, radius, items)
        if place is not None:
            return place
        disc_radius *= 1.15


def _position_in_front(
    radius: float,
    target: Item,
    items: Sequence[Item],
    toward_eye: Float[np.ndarray, "2"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "2"] | None:
    """A random free position between a target and the eye; None if none is found."""
    distance = target.radius + radius + rng.uniform(GAP, 0.02, _TRIES)
    turn = np.arctan2(toward_eye[1], toward_eye[0]) + rng.uniform(-0.4, 0.4, _TRIES)
    steps = distance[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    return _first_free(target.center + steps, radius, items)


def _first_free(
    places: Float[np.ndarray, "n 2"], radius: float, items: Sequence[Item]
) -> Float[np.ndarray, "2"] | None:
    """The first position at which a circle does not overlap the items'; None if there is none."""
    if not items:
        return np.asarray(places[0])
    apart = np.linalg.norm(places[:, None] - np.stack([i.center for i in items]), axis=-1)
    free = (apart >= radius + GAP + np.array([i.radius for i in items])).all(axis=1)
    return np.asarray(places[np.argmax(free)]) if free.any() else None


def look_at(
    target: Float[np.ndarray, "3"],
    distance: float,
    azimuth: float,
    elevation: float,
    roll: float,
) -> Float[np.ndarray, "4 4"]:
    """pose_cam_world of a camera at a distance (m) and angles (rad), looking at a point (m)."""
    flat = np.cos(elevation)
    back = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    axes = np.stack([right, np.cross(-back, right), -back], axis=1)
    rolled = axes @ Rotation.from_rotvec([0.0, 0.0, roll]).as_matrix()
    return inverse(rigid(rolled, target + distance * back))


def light_from_above(pose_cam_world: Float[np.ndarray, "4 4"], rng: np.random.Generator) -> Light:
    """A random light at least 25° above the table and on the camera's side."""
    while True:
        world = rng.normal(size=3)
        world /= np.linalg.norm(world)
        x, y, z = (float(value) for value in pose_cam_world[:3, :3] @ world)
        if world[2] > np.sin(np.radians(25.0)) and z < 0.0:
            break
    return Light(
        direction=(x, y, z),
        ambient=float(rng.uniform(0.35, 0.6)),
        diffuse=float(rng.uniform(0.35, 0.7)),
        specular=float(rng.uniform(0.0, 0.3)),
        shininess=float(rng.uniform(8.0, 40.0)),
    )


def random_shape(rng: np.random.Generator, least_height: float = 0.04) -> Mesh:
    """A box, cylinder, ball, cone, ring or vase, of one colour or striped.

    Boxes, cylinders, cones and vases are `least_height` to 20 cm high.
    """
    kind = int(rng.integers(6))
    color = _random_color(rng)
    width, height = rng.uniform(0.02, 0.045), rng.uniform(least_height, 0.20)
    if kind == 0:
        size = (2 * width, rng.uniform(0.03, 0.10), height)
        mesh = rounded_box(size, rng.uniform(0.002, 0.008), color, _SPACING)
    elif kind == 1:
        mesh = cylinder(width, height, color, _SPACING)
    elif kind == 2:
        mesh = ellipsoid((width, width * rng.uniform(0.8, 1.2), width), color, _SPACING)
    elif kind == 3:
        mesh = lathe([(0, 0), (width, 0), (width, 0.006), (0, height)], color, spacing=_SPACING)
    elif kind == 4:
        mesh = _ring(width, rng.uniform(0.007, 0.014), color)
    else:
        mesh = _vase(width, height, color, rng)
    if rng.uniform() < 0.4:
        return _striped(mesh, _random_color(rng), rng)
    return mesh


def _ring(radius: float, thickness: float, color: Color) -> Mesh:
    """A ring standing on its edge."""
    angle = np.linspace(0.0, 2 * np.pi, 40)
    circle = np.column_stack([np.cos(angle), np.zeros(40), np.sin(angle)]) * radius
    return tube(circle.tolist(), [thickness] * 40, color, _SPACING)


def _vase(width: float, height: float, color: Color, rng: np.random.Generator) -> Mesh:
    heights = np.linspace(0.0, height, 5)
    radii = width * rng.uniform(0.3, 1.0, 5)
    wall = [(float(r), float(z)) for r, z in zip(radii, heights, strict=True)]
    return lathe([(0.0, 0.0), *wall, (0.0, height)], color, spacing=_SPACING)


def _striped(mesh: Mesh, color: Color, rng: np.random.Generator) -> Mesh:
    """Stripes perpendicular to a random direction, like the print on packages."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    along = mesh.vertices @ direction
    return painted(mesh, np.sin(2 * np.pi * along / rng.uniform(0.03, 0.09)) > 0.3, color)


def toy_tree(crown: float, height: float, rng: np.random.Generator) -> Mesh:
    """A tree of a foot, a thin trunk, and a crown of radius `crown` (m) centred at `height` (m)."""
    half = crown * rng.uniform(0.9, 1.6)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 9)[1:-1]
    low = max(height - half, 0.012)
    rounds = [(float(crown * np.cos(a)), float(low + half * (1 + np.sin(a)))) for a in angle]
    foot = [(0.0, 0.0), (0.7 * crown, 0.0), (0.7 * crown, 0.006), (0.006, 0.009), (0.006, low)]
    tree = lathe([*foot, *rounds, (0.0, low + 2 * half)], _random_color(rng), spacing=_SPACING)
    return painted(tree, tree.vertices[:, 2] < low + 0.004, _random_color(rng))


def _random_color(rng: np.random.Generator) -> Color:
    grey = rng.uniform(30.0, 225.0)
    channels = np.clip(grey + rng.normal(0.0, 45.0, 3), 10, 240).astype(int)
    red, green, blue = (int(value) for value in channels)
    return red, green, blue
