"""The second demo: flat parts without colours, several of each, piled in a bin.

World coordinates are those of `hlp.data.synthetic.layout`; the bin stands on the table's middle.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float, Int
from numpy.lib.stride_tricks import sliding_window_view

from hlp.arrays import Point, Pose
from hlp.data.dataset import DATASETS, Dataset
from hlp.data.synthetic.layout import Elevation, Item, SceneCount, SceneSettings, between
from hlp.data.synthetic.objects import shape_model
from hlp.data.synthetic.scenes import SyntheticScenes, dataset_of
from hlp.geometry import rigid
from hlp.objects.distractors import random_color, random_shape
from hlp.objects.mesh_colors import PLAIN_COLOR
from hlp.objects.meshes import mesh_diameter
from hlp.objects.shapes import CUBE, box_walls, centred, hull_mesh, lathe, merge, moved, rounded_box
from hlp.records import Mesh, ObjectModel
from hlp.rendering.rasterizer import render_depth
from hlp.settings import Count, Doc, NotNegative, WholeNumber

Heights = Float[np.ndarray, "h w"]

_PAINTS = ((212, 172, 40), (124, 126, 130), (40, 40, 42))  # yellow, grey, black
_REACH = (0.085, 0.125)  # m, from the bin's middle to a wall
_HEIGHT = (0.05, 0.09)  # m, of the walls
_THICK = 0.004  # m, walls and floor
_ROUGH = (0.03, 0.06)  # m, diameters of other things in the bin
_CELL = 0.002  # m, of the map of heights
_MARGIN = 0.06  # m of that map beyond the walls
_FAR = 50.0  # m: from there a camera sees heights without perspective
_PLACES, _STEPS, _TRIALS = 50, 20, 12  # tried, to drop a part; it settles by the best of each step
_TURNS = (np.deg2rad(10.0), np.deg2rad(0.3))  # in the first and in the last step
_UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0])
_EDGE = 0.005  # m, of a triangle of a part


@DATASETS.register
@dataclass(frozen=True)
class BinSettings(SceneSettings):
    """Config group `data`: the synthetic bin, flat parts without colours, several in a frame.

    Every value is ours (D). Ranges are [least, most].
    """

    name: Literal["bin"] = "bin"
    scenes: SceneCount = 12
    objects: Annotated[
        tuple[Count, Annotated[int, Le(20)]],
        Doc("smallest and largest number of parts in the bin (D)"),
    ] = (4, 8)
    clutter: Annotated[
        tuple[WholeNumber, Annotated[int, Le(30)]], Doc("the same for other things in it (D)")
    ] = (1, 3)
    distance_mm: Annotated[
        tuple[Annotated[float, Ge(450)], Annotated[float, Le(3000)]],
        Doc("from the camera to the scene's middle (D)"),
    ] = (500.0, 800.0)
    elevation_deg: Elevation = (50.0, 85.0)
    tilt_deg: Annotated[NotNegative, Doc("largest lean of a part when it is dropped (D)")] = 25.0

    def build(self) -> Dataset:
        """The parts and their scenes; the demo's frames without objects to train with."""
        return dataset_of(self, BinScenes(self), bin_parts())


class BinScenes(SyntheticScenes):
    """A `FrameSource` of bins with one frame each; see `SyntheticScenes`."""

    def _place(self, eye: Point, rng: np.random.Generator) -> list[Item]:
        """The bin, and in it parts of one paint and other things, dropped one after another."""
        reach = rng.uniform(*_REACH, (2, 2))
        bin_items = _bin(reach, rng)
        heights = _empty_bin(reach)
        paint = np.array(_PAINTS[int(rng.integers(len(_PAINTS)))]) * rng.uniform(0.85, 1.1)
        kinds = rng.integers(1, len(bin_parts()) + 1, between(self.settings.objects, rng))
        things = [(int(kind), _painted(bin_parts()[int(kind)].mesh, paint)) for kind in kinds]
        things += [(0, _small_shape(rng)) for _ in range(between(self.settings.clutter, rng))]
        items = []
        for number in rng.permutation(len(things)):
            object_id, mesh = things[number]
            pose = _settle(mesh, heights, np.radians(self.settings.tilt_deg), rng)
            if pose is not None:
                items.append(Item(object_id, mesh, mesh, pose, pose[:2, 3], 0.0))
        return [*items, *bin_items]


def _bin(reach: Float[np.ndarray, "2 2"], rng: np.random.Generator) -> list[Item]:
    """Walls and floor."""
    color = np.array(random_color(rng), dtype=np.uint8)
    walls = box_walls(reach, float(rng.uniform(*_HEIGHT)), _THICK, color)
    sides = np.array([*reach.sum(axis=1), _THICK])
    middle = np.array([*(reach[:, 0] - reach[:, 1]) / 2, _THICK / 2])
    parts = [*walls, (hull_mesh(CUBE * sides / 2, color), middle)]
    return [Item(0, mesh, mesh, rigid(np.eye(3), at), at[:2], 0.0) for mesh, at in parts]


def _painted(mesh: Mesh, paint: Point) -> Mesh:
    color = np.clip(paint, 0, 255).astype(np.uint8)
    return replace(mesh, colors=np.tile(color, (len(mesh.vertices), 1)), colored=True)


def _small_shape(rng: np.random.Generator) -> Mesh:
    """A random shape about the origin."""
    mesh = centred(random_shape(rng))
    scale = rng.uniform(*_ROUGH) / mesh_diameter(mesh.vertices)
    return replace(mesh, vertices=mesh.vertices * scale)


def _empty_bin(reach: Float[np.ndarray, "2 2"]) -> Heights:
    """Height (m) of what lies in each cell of a bin, infinite beyond its inner sides.

    Columns are x, rows y; the middle of the map is the origin.
    """
    half = int(np.ceil((reach.max() + _MARGIN) / _CELL))
    along = np.arange(-half, half + 1) * _CELL
    x, y = ((along > -low) & (along < high) for high, low in reach)
    return np.where(y[:, None] & x, _THICK, np.inf)


def _settle(mesh: Mesh, heights: Heights, tilt: float, rng: np.random.Generator) -> Pose | None:
    """Drop a mesh on what lies in the bin, let it slide to a low place, add it to the heights.

    Each step is the best of random turns and shifts, if the mesh's middle gets lower: so it comes
    to lie flat, across others or against a wall. Its pose in the world; None if it fits nowhere.
    """
    from scipy.spatial.transform import Rotation

    side = int(np.ceil(mesh_diameter(mesh.vertices) / _CELL)) + 3
    last = len(heights) - side
    face = Rotation.from_rotvec([np.pi * rng.integers(2), 0.0, 0.0])
    yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 2 * np.pi)])
    turn = yaw * Rotation.from_rotvec(rng.uniform(-tilt, tilt, 3) * [1.0, 1.0, 0.0]) * face
    places = rng.integers(0, last + 1, (_PLACES, 2))
    below = _undersides(mesh, turn.as_matrix()[None], side)
    resting = _resting_heights(heights, np.repeat(below, _PLACES, axis=0), places)
    chosen = int(np.argmax(np.isfinite(resting)))
    place, height = places[chosen], float(resting[chosen])
    if not np.isfinite(height):
        return None
    for angle in np.geomspace(*_TURNS, _STEPS):
        turns = Rotation.from_rotvec(rng.normal(0.0, angle, (_TRIALS, 3))) * turn
        moved_to = np.clip(place + rng.integers(-1, 2, (_TRIALS, 2)), 0, last)
        below = _undersides(mesh, turns.as_matrix(), side)
        resting = _resting_heights(heights, below, moved_to)
        best = int(np.argmin(resting))
        if resting[best] < height:
            turn, place, height = turns[best], moved_to[best], float(resting[best])
    above = _undersides(mesh, (_UPSIDE_DOWN @ turn.as_matrix())[None], side)[0, ::-1]
    window = heights[place[0] : place[0] + side, place[1] : place[1] + side]
    covered = np.isfinite(above)
    window[covered] = np.maximum(window[covered], height - above[covered])
    x, y = (place[::-1] + (side - 1) / 2 - (len(heights) - 1) / 2) * _CELL
    return rigid(turn.as_matrix(), np.array([x, y, height]))


def _undersides(
    mesh: Mesh, rotations: Float[np.ndarray, "n 3 3"], side: int
) -> Float[np.ndarray, "n side side"]:
    """Height (m) of the lowest point of a turned mesh in each cell around its origin (or ∞)."""
    scale, middle = _FAR / _CELL, (side - 1) / 2
    camera = np.array([[scale, 0, middle], [0, scale, middle], [0, 0, 1]])
    poses = rigid(rotations, np.tile([0.0, 0.0, _FAR], (len(rotations), 1)))
    depth = render_depth(mesh, poses, camera, (side, side), threads=1)
    return np.where(depth > 0.0, depth.astype(np.float64) - _FAR, np.inf)


def _resting_heights(
    heights: Heights, below: Float[np.ndarray, "n side side"], places: Int[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n"]:
    """Height at which each underside, put at its place, touches what lies there."""
    side = below.shape[1]
    there = sliding_window_view(heights, (side, side))[places[:, 0], places[:, 1]]
    covered = np.isfinite(below)
    gaps = np.where(covered, there - np.where(covered, below, 0.0), -np.inf)
    return np.asarray(gaps.max(axis=(1, 2)))


@lru_cache(maxsize=1)
def bin_parts() -> dict[int, ObjectModel]:
    """A bracket and a lever by object id, built once. Neither has a symmetry."""
    meshes = {"bracket": _bracket(), "lever": _lever()}
    return {
        object_id: shape_model(object_id, name, _plain(centred(mesh)))
        for object_id, (name, mesh) in enumerate(meshes.items(), start=1)
    }


def _plain(mesh: Mesh) -> Mesh:
    """The mesh without colours, and with flat faces, which have vertices of their own."""
    vertices = mesh.vertices[mesh.faces]
    normals = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces = np.arange(vertices.size // 3).reshape(-1, 3)
    colors = np.tile(np.array(PLAIN_COLOR, dtype=np.uint8), (vertices.size // 3, 1))
    points, normals = vertices.reshape(-1, 3), np.repeat(normals, 3, axis=0)
    return Mesh(points, faces, colors, normals, colored=False)


def _bracket() -> Mesh:
    """An L of two arms with an eye at each end, 14 mm thick."""
    eyes = [((0.0, 0.0), 0.004), ((0.062, 0.0), 0.006), ((0.0, 0.040), 0.006)]
    arms = [((0.031, 0.0), (0.046, 0.022)), ((0.0, 0.020), (0.022, 0.024))]
    return merge(
        *(moved(_eye(0.013, bore, 0.014), (*place, 0.0)) for place, bore in eyes),
        *(moved(_bar(size, 0.014), (*place, 0.0)) for place, size in arms),
    )


def _lever() -> Mesh:
    """An arm, 12 mm thick, from a hub, 20 mm thick, to a smaller eye."""
    hub, arm = _eye(0.015, 0.006, 0.020), _bar((0.062, 0.016), 0.012)
    return merge(hub, moved(arm, (0.039, 0, 0)), moved(_eye(0.010, 0.004, 0.012), (0.075, 0, 0)))


def _eye(radius: float, bore: float, thickness: float) -> Mesh:
    """A ring that lies on z = 0 (m)."""
    profile = [(bore, 0.0), (radius, 0.0), (radius, thickness), (bore, thickness), (bore, 0.0)]
    return lathe(profile, PLAIN_COLOR, spacing=_EDGE)


def _bar(size: tuple[float, float], thickness: float) -> Mesh:
    """A box that lies on z = 0 (m)."""
    box = rounded_box((*size, thickness), 0.001, PLAIN_COLOR, spacing=_EDGE)
    return moved(box, (0.0, 0.0, thickness / 2))
