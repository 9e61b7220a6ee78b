"""Layout of a demo scene: objects, clutter and occluders on a table, camera and light.

World coordinates are in metres, z up; the origin is the middle of the table's top.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le, Unit
from jaxtyping import Float

from hlp.arrays import Pose, Positions, Vector
from hlp.geometry import inverse, rigid
from hlp.objects.distractors import random_shape, toy_tree
from hlp.records import Mesh, ObjectModel
from hlp.rendering.shading import Light
from hlp.settings import Count, Doc, NotNegative, Part, Settings, SettingsError, WholeNumber

GAP = 0.004
"""Least distance (m) between the circles that items occupy on the table."""
_TRIES = 60
SceneCount = Annotated[WholeNumber, Le(100_000), Doc("number of scenes, with one frame each (D)")]
Elevation = Annotated[
    tuple[Annotated[float, Ge(10)], Annotated[float, Le(90)]],
    Doc("angle of the camera above the table (D)"),
]


@dataclass(frozen=True)
class SceneSettings(Settings):
    """What all rendered scenes have in common. Every value is ours (D). Ranges are [least, most].

    The defaults are the demo's.
    """

    scenes: SceneCount = 24
    seed: Annotated[WholeNumber, Le(2**32 - 1), Doc("seed of the scenes (D)")] = 0
    width: Annotated[
        int,
        Ge(32),
        Le(8192),
        Unit("px"),
        Doc("image width; LINEMOD's intrinsics scale with it, errors of depth do not (P: 640)"),
    ] = 640
    height: Annotated[
        int | None,
        Ge(32),
        Le(8192),
        Unit("px"),
        Doc("image height; null: three quarters of the width (P: 480)"),
    ] = None
    noise: Annotated[
        NotNegative, Le(100), Doc("sensor noise: 1 = a Kinect, 0 = an ideal camera (D)")
    ] = 1.0
    min_visible: Annotated[
        Part, Doc("objects with a smaller visible fraction are no targets (D)")
    ] = 0.3
    objects: Annotated[
        tuple[Count, Annotated[int, Le(8)]],
        Doc("smallest and largest number of demo objects in a scene (D)"),
    ] = (5, 8)
    clutter: Annotated[
        tuple[WholeNumber, Annotated[int, Le(30)]],
        Doc("the same for other shapes; two of three stand in front of an object (D)"),
    ] = (6, 12)
    distance_mm: Annotated[
        tuple[Annotated[float, Ge(450)], Annotated[float, Le(3000)]],
        Doc("from the camera to the scene's middle (D: LINEMOD's range)"),
    ] = (600.0, 1100.0)
    elevation_deg: Elevation = (20.0, 75.0)
    roll_deg: Annotated[NotNegative, Doc("largest roll of the camera, in both directions (D)")] = (
        20.0
    )
    tilt_deg: Annotated[NotNegative, Doc("largest lean of an object (D)")] = 5.0
    background_frames: Annotated[
        WholeNumber, Le(1000), Doc("scenes without the objects, to train with (D)")
    ] = 40

    def __post_init__(self) -> None:
        """Raise SettingsError naming the key that makes no scene."""
        super().__post_init__()
        for key in ("objects", "clutter", "distance_mm", "elevation_deg"):
            limits = getattr(self, key)
            if len(limits) != 2 or limits[0] > limits[1]:
                raise SettingsError(key, f"is {list(limits)}: it must be [least, most]")

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the images (px)."""
        return self.height or self.width * 3 // 4, self.width


@dataclass(frozen=True)
class Item:
    """A shape on the table inside a circle of `center` and `radius` (m), seen from above.

    `object_id` is 0 for clutter. `coarse` is a mesh of fewer triangles, for its shadow.
    """

    object_id: int
    mesh: Mesh
    coarse: Mesh
    pose_world_obj: Pose
    center: Float[np.ndarray, "2"]
    radius: float

    def at(self, place: Float[np.ndarray, "2"]) -> "Item":
        """The same item, moved from the middle of the table to a position (x, y) on it (m)."""
        pose = self.pose_world_obj.copy()
        pose[:2, 3] += place
        return replace(self, pose_world_obj=pose, center=place)


def set_upright(
    object_id: int, mesh: Mesh, coarse: Mesh, tilt: float, rng: np.random.Generator
) -> Item:
    """Set a mesh on the middle of the table: a random yaw, and a lean of up to `tilt` (rad)."""
    from scipy.spatial.transform import Rotation

    lean = rng.uniform(0.0, tilt)
    direction = rng.uniform(0.0, 2 * np.pi)
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 2 * np.pi)])
    rotation = (Rotation.from_rotvec(lean * axis) * yaw).as_matrix()
    points = mesh.vertices @ rotation.T
    low, high = points.min(axis=0), points.max(axis=0)
    offset = -np.array([*(low + high)[:2] / 2, low[2]])
    radius = float(np.linalg.norm((points + offset)[:, :2], axis=1).max())
    return Item(object_id, mesh, coarse, rigid(rotation, offset), np.zeros(2), radius)


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
    count: int, items: Sequence[Item], eye: Vector, rng: np.random.Generator
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
    tree: bool, target: Item, items: Sequence[Item], eye: Vector, rng: np.random.Generator
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
    places: Positions, radius: float, items: Sequence[Item]
) -> Float[np.ndarray, "2"] | None:
    """The first position at which a circle does not overlap the items'; None if there is none."""
    if not items:
        return np.asarray(places[0])
    apart = np.linalg.norm(places[:, None] - np.stack([i.center for i in items]), axis=-1)
    free = (apart >= radius + GAP + np.array([i.radius for i in items])).all(axis=1)
    return np.asarray(places[np.argmax(free)]) if free.any() else None


def look_at(target: Vector, distance: float, azimuth: float, elevation: float, roll: float) -> Pose:
    """pose_cam_world of a camera at a distance (m) and angles (rad), looking at a point (m)."""
    from scipy.spatial.transform import Rotation

    flat = np.cos(elevation)
    back = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    axes = np.stack([right, np.cross(-back, right), -back], axis=1)
    rolled = axes @ Rotation.from_rotvec([0.0, 0.0, roll]).as_matrix()
    return inverse(rigid(rolled, target + distance * back))


def light_from_above(pose_cam_world: Pose, rng: np.random.Generator) -> Light:
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


def between(limits: Sequence[int], rng: np.random.Generator) -> int:
    """A random number from the least to the most, both included."""
    return int(rng.integers(limits[0], limits[1] + 1))
