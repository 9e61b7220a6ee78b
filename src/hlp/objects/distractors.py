"""Random shapes, and scenes of them that look like the objects to learn here and there.

A classifier that has seen only its objects and flat backgrounds takes whatever sticks out for an
object. The scenes show random shapes of the objects' sizes in arbitrary colours, in the objects'
colours and with the objects' prints.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from hlp.geometry import rigid
from hlp.objects.meshes import mesh_diameter
from hlp.objects.shapes import (
    Color,
    centred,
    cylinder,
    ellipsoid,
    lathe,
    merge,
    moved_by,
    painted,
    rounded_box,
    tube,
)
from hlp.records import Frame, Mesh
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.shading import random_light

_SHAPES = 60  # different ones
_SIDE = 320  # px of a scene's image
_FOCAL = 572.0  # px, as in the objects' views
_DISTANCES = (0.5, 1.2)  # m from the camera to the supporting plane
_SCALES = (0.4, 2.5)  # diameters relative to the objects'
_THINGS = (6, 14)  # in a scene
_WALL = 1.6  # m: side of the supporting plane
_COARSE = 0.007  # m between vertices


def distractor_scenes(meshes: Sequence[Mesh], count: int, seed: int, threads: int) -> list[Frame]:
    """`count` RGB-D frames of random shapes before a plane, without any of the objects.

    `meshes` are the objects'. Shapes have 0.4 to 2.5 times the diameter of a random object.
    Deterministic in `seed`, whatever the number of `threads`.
    """
    rng = np.random.default_rng([seed, 0])
    shapes = [_random_thing(rng) for _ in range(_SHAPES)] if count else []
    objects = [_unit_size(mesh) for mesh in meshes]

    def draw(number: int) -> Frame:
        return _scene(objects, shapes, number, np.random.default_rng([seed, 1, number]))

    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(draw, range(count)))


def _random_thing(rng: np.random.Generator) -> Mesh:
    """One to four random shapes stuck together, about the origin, with a diameter of 1."""
    parts = []
    for _ in range(int(rng.integers(1, 5))):
        turn = _random_turn(rng)
        parts.append(moved_by(random_shape(rng), rigid(turn, rng.normal(0.0, 0.03, 3))))
    return _unit_size(merge(*parts))[0]


def _random_turn(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    from scipy.spatial.transform import Rotation  # slow to import

    return np.asarray(Rotation.random(random_state=rng).as_matrix())


def _unit_size(mesh: Mesh) -> tuple[Mesh, float]:
    """The mesh about the origin with a diameter of 1, and its former diameter (m)."""
    diameter = mesh_diameter(mesh.vertices)
    return replace(mesh, vertices=centred(mesh).vertices / diameter), diameter


def _scene(
    objects: Sequence[tuple[Mesh, float]],
    shapes: Sequence[Mesh],
    number: int,
    rng: np.random.Generator,
) -> Frame:
    """A scene of `shapes` (of diameter 1) that resemble `objects` (meshes of diameter 1, sizes)."""
    from scipy.spatial.transform import Rotation  # slow to import

    middle = (_SIDE - 1) / 2
    camera_matrix = np.array([[_FOCAL, 0.0, middle], [0.0, _FOCAL, middle], [0.0, 0.0, 1.0]])
    distance = rng.uniform(*_DISTANCES)
    tilt = Rotation.from_rotvec(rng.uniform(-1.0, 1.0, 3) * [1.0, 1.0, 0.0]).as_matrix()
    plane_pose = rigid(tilt, np.array([0.0, 0.0, distance]))
    parts = [(_plane(rng), plane_pose)]
    reach = distance * _SIDE / _FOCAL / 2
    for _ in range(int(rng.integers(_THINGS[0], _THINGS[1] + 1))):
        look, diameter = objects[int(rng.integers(len(objects)))]
        scale = diameter * np.exp(rng.uniform(*np.log(_SCALES)))
        shape = shapes[int(rng.integers(len(shapes)))]
        turn = _random_turn(rng)
        # Before the plane (negative z is towards the camera), most touching or cutting it.
        place = np.array([*rng.uniform(-reach, reach, 2), -scale * rng.uniform(0.1, 0.8)])
        place = plane_pose[:3, :3] @ place + plane_pose[:3, 3]
        mesh = replace(shape, vertices=shape.vertices * scale, colors=_paint(shape, look, rng))
        parts.append((mesh, rigid(turn, place)))
    rgb, depth, _ = render_scene(parts, camera_matrix, (_SIDE, _SIDE), random_light(rng))
    return Frame(0, number, rgb, depth, camera_matrix)


def _paint(shape: Mesh, look: Mesh, rng: np.random.Generator) -> UInt8[np.ndarray, "v 3"]:
    """Colours of a thing's vertices: its own, random ones, an object's, or its print.

    `shape` and the object (`look`) are about the origin and of diameter 1.
    """
    kind = int(rng.integers(4))
    if kind == 0:
        return shape.colors
    if kind == 1:
        return _blend(shape, np.array([random_color(rng) for _ in range(2)]), rng)
    if kind == 2:
        seen = look.colors[rng.integers(len(look.colors), size=2)]
        return _blend(shape, seen.astype(np.float64), rng)
    # The object's surface point at the same place in the bounding box, after a random turn.
    from scipy.spatial import cKDTree  # slow to import

    turn = _random_turn(rng)
    sample = rng.integers(len(look.vertices), size=4000)
    tree = cKDTree(look.vertices[sample])
    _, nearest = tree.query(shape.vertices @ turn.T)
    return np.asarray(look.colors[sample[nearest]])


def _blend(
    shape: Mesh, colors: Float[np.ndarray, "2 3"], rng: np.random.Generator
) -> UInt8[np.ndarray, "v 3"]:
    """A smooth pattern of two colours, with borders that are soft or sharp."""
    waves = np.sin(shape.vertices @ rng.normal(0.0, 8.0, (3, 3)) + rng.uniform(0, 2 * np.pi, 3))
    share = 1.0 / (1.0 + np.exp(-rng.choice([1.0, 30.0]) * (waves.sum(axis=1) - rng.normal())))
    mixed = colors[0] + share[:, None] * (colors[1] - colors[0])
    return np.asarray(np.rint(mixed), dtype=np.uint8)


def _plane(rng: np.random.Generator) -> Mesh:
    """A square about the origin facing -z, of two colours."""
    steps = np.linspace(-_WALL / 2, _WALL / 2, 81)
    x, y = np.meshgrid(steps, steps)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    number = np.arange(x.size).reshape(x.shape)
    a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    c, d = number[1:, 1:].ravel(), number[1:, :-1].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    normals = np.tile([0.0, 0.0, -1.0], (len(vertices), 1))
    plane = Mesh(vertices, faces, np.zeros((len(vertices), 3), np.uint8), normals)
    colors = np.array([random_color(rng) for _ in range(2)], dtype=np.float64)
    return replace(plane, colors=_blend(plane, colors, rng))


def random_shape(rng: np.random.Generator, least_height: float = 0.04) -> Mesh:
    """A box, cylinder, ball, cone, ring or vase, of one colour or striped.

    Boxes, cylinders, cones and vases are `least_height` to 20 cm high.
    """
    kind = int(rng.integers(6))
    color = random_color(rng)
    width, height = rng.uniform(0.02, 0.045), rng.uniform(least_height, 0.20)
    if kind == 0:
        size = (2 * width, rng.uniform(0.03, 0.10), height)
        mesh = rounded_box(size, rng.uniform(0.002, 0.008), color, _COARSE)
    elif kind == 1:
        mesh = cylinder(width, height, color, _COARSE)
    elif kind == 2:
        mesh = ellipsoid((width, width * rng.uniform(0.8, 1.2), width), color, _COARSE)
    elif kind == 3:
        mesh = lathe([(0, 0), (width, 0), (width, 0.006), (0, height)], color, spacing=_COARSE)
    elif kind == 4:
        mesh = _ring(width, rng.uniform(0.007, 0.014), color)
    else:
        mesh = _vase(width, height, color, rng)
    if rng.uniform() < 0.4:
        return _striped(mesh, random_color(rng), rng)
    return mesh


def _ring(radius: float, thickness: float, color: Color) -> Mesh:
    """A ring standing on its edge."""
    angle = np.linspace(0.0, 2 * np.pi, 40)
    circle = np.column_stack([np.cos(angle), np.zeros(40), np.sin(angle)]) * radius
    return tube(circle.tolist(), [thickness] * 40, color, _COARSE)


def _vase(width: float, height: float, color: Color, rng: np.random.Generator) -> Mesh:
    heights = np.linspace(0.0, height, 5)
    radii = width * rng.uniform(0.3, 1.0, 5)
    wall = [(float(r), float(z)) for r, z in zip(radii, heights, strict=True)]
    return lathe([(0.0, 0.0), *wall, (0.0, height)], color, spacing=_COARSE)


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
    tree = lathe([*foot, *rounds, (0.0, low + 2 * half)], random_color(rng), spacing=_COARSE)
    return painted(tree, tree.vertices[:, 2] < low + 0.004, random_color(rng))


def random_color(rng: np.random.Generator) -> Color:
    """A muted random colour (red, green, blue)."""
    grey = rng.uniform(30.0, 225.0)
    channels = np.clip(grey + rng.normal(0.0, 45.0, 3), 10, 240).astype(int)
    red, green, blue = (int(value) for value in channels)
    return red, green, blue
