"""Closed, coloured surfaces from which objects are assembled, and the walls of a bin.

Every shape is a `Mesh` in metres whose vertices are at most about `SPACING` apart, so that
interpolated colours and shading look smooth. `merge` keeps surfaces inside other shapes, which a
z-buffer hides anyway.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from hlp.arrays import Flags, Point, Points, Pose
from hlp.geometry import rigid, transform
from hlp.records import Mesh

SPACING = 0.004  # m
Color = tuple[int, int, int]
CUBE = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
"""Corners of a cube."""


def solid(vertices: Points, faces: Int[np.ndarray, "f 3"], color: Color) -> Mesh:
    """A closed surface of one colour; equal vertices become one, normals point outwards."""
    import trimesh

    surface = trimesh.Trimesh(vertices, faces, process=True)
    surface.update_faces(surface.nondegenerate_faces())
    surface.remove_unreferenced_vertices()
    if surface.volume < 0:
        surface.invert()
    return Mesh(
        vertices=np.array(surface.vertices, dtype=np.float64),
        faces=np.array(surface.faces, dtype=np.int64),
        colors=np.tile(np.array(color, dtype=np.uint8), (len(surface.vertices), 1)),
        normals=np.array(surface.vertex_normals, dtype=np.float64),
    )


def merge(*parts: Mesh) -> Mesh:
    """One mesh with the vertices and faces of several."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=True)]),
        colors=np.concatenate([part.colors for part in parts]),
        normals=np.concatenate([part.normals for part in parts]),
    )


def moved(
    mesh: Mesh,
    translation: Sequence[float] = (0.0, 0.0, 0.0),
    euler_deg: Sequence[float] = (0.0, 0.0, 0.0),
) -> Mesh:
    """Turn about the fixed x, then y, then z axis (degrees), then shift (m)."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler("xyz", euler_deg, degrees=True).as_matrix()
    return moved_by(mesh, rigid(turn, np.asarray(translation, dtype=np.float64)))


def moved_by(mesh: Mesh, motion: Pose) -> Mesh:
    """The mesh after a rigid motion."""
    vertices = transform(motion, mesh.vertices)
    return replace(mesh, vertices=vertices, normals=mesh.normals @ motion[:3, :3].T)


def centred(mesh: Mesh) -> Mesh:
    """The mesh with the middle of its bounding box at the origin."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return moved(mesh, -(low + high) / 2)


def painted(mesh: Mesh, where: Flags, color: Color) -> Mesh:
    """The mesh with another colour at the vertices `where`."""
    colors = mesh.colors.copy()
    colors[where] = color
    return replace(mesh, colors=colors)


def lathe(
    profile: Sequence[tuple[float, float]],
    color: Color,
    segments: int | None = None,
    spacing: float = SPACING,
) -> Mesh:
    """Surface of revolution about z of the open line `profile` of (radius, height), in metres.

    The line should begin and end on the axis (radius 0), so that the surface is closed. `segments`
    is the number of steps around the axis; by default it follows from `spacing` (m).
    """
    line = _resampled(np.asarray(profile, dtype=np.float64), spacing)
    count = segments or max(12, int(np.ceil(2 * np.pi * line[:, 0].max() / spacing)))
    return _grid_surface(_revolved(line, count), color)


def cylinder(radius: float, height: float, color: Color, spacing: float = SPACING) -> Mesh:
    """Upright cylinder that stands on z = 0."""
    corners = [(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)]
    return lathe(corners, color, spacing=spacing)


def ellipsoid(radii: Sequence[float], color: Color, spacing: float = SPACING) -> Mesh:
    """Ellipsoid about the origin with half axes `radii` (m)."""
    largest = max(radii)
    steps = max(10, int(np.ceil(np.pi * largest / spacing)))
    angle = np.linspace(0.0, np.pi, steps + 1)
    radius = np.sin(angle)
    radius[[0, -1]] = 0.0
    around = max(12, int(np.ceil(2 * np.pi * max(radii[:2]) / spacing)))
    sphere = _revolved(np.column_stack([radius, -np.cos(angle)]), around)
    return _grid_surface(sphere * np.asarray(radii), color)


def rounded_box(
    size: Sequence[float], rounding: float, color: Color, spacing: float = SPACING
) -> Mesh:
    """Box about the origin with sides `size` and edges rounded with a radius `rounding` (m).

    The points of a fine grid on a box are moved to the distance `rounding` from an inner box.
    """
    half = np.asarray(size, dtype=np.float64) / 2
    inner = half - rounding
    vertices, faces = _box_grid(half, spacing)
    nearest = np.clip(vertices, -inner, inner)
    away = vertices - nearest
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return solid(nearest + rounding * away, faces, color)


def tube(
    path: Sequence[Sequence[float]], radii: Sequence[float], color: Color, spacing: float = SPACING
) -> Mesh:
    """Tube along the line `path` (k, 3) with radius `radii` (k,) at each point, flat ends (m)."""
    line = _resampled(np.column_stack([np.asarray(path), np.asarray(radii)]), spacing)
    along = np.gradient(line[:, :3], axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = _parallel_transport(along)
    second = np.cross(along, across)
    count = max(10, int(np.ceil(2 * np.pi * line[:, 3].max() / spacing)))
    angle = np.arange(count) * (2 * np.pi / count)
    circle = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * second[:, None]
    first, last = (_end_cap(line[end], spacing) for end in (0, -1))
    rings = np.concatenate([first[::-1], line, last])
    ends = np.repeat(circle[:1], len(first), 0), np.repeat(circle[-1:], len(last), 0)
    circles = np.concatenate([ends[0], circle, ends[1]])
    return _grid_surface(rings[:, None, :3] + rings[:, None, 3:] * circles, color)


def _end_cap(end: Float[np.ndarray, "4"], spacing: float) -> Float[np.ndarray, "n 4"]:
    """Rings (x, y, z, radius) that close a tube with a flat end, down to radius 0."""
    steps = max(1, int(np.ceil(end[3] / spacing)))
    rings = np.tile(end, (steps, 1))
    rings[:, 3] *= np.arange(steps - 1, -1, -1) / steps
    return rings


def _parallel_transport(along: Points) -> Points:
    """A unit vector perpendicular to the line at each of its points, without twist."""
    across = np.empty_like(along)
    start = np.eye(3)[np.argmin(np.abs(along[0]))]
    for i, direction in enumerate(along):
        start = start - direction * (start @ direction)
        start /= np.linalg.norm(start)
        across[i] = start
    return across


def _resampled(line: Float[np.ndarray, "k d"], spacing: float) -> Float[np.ndarray, "n d"]:
    """The polyline with points added so that neighbours are at most `spacing` (m) apart."""
    pieces = [line[:1]]
    for start, end in pairwise(line):
        steps = max(1, int(np.ceil(np.linalg.norm(end - start) / spacing)))
        share = np.arange(1, steps + 1)[:, None] / steps
        pieces.append(start + share * (end - start))
    return np.concatenate(pieces)


def _revolved(line: Float[np.ndarray, "n 2"], steps: int) -> Float[np.ndarray, "n steps 3"]:
    """The points (radius, height) of a line, turned about z in so many steps."""
    angles = np.arange(steps) * (2 * np.pi / steps)
    ring = line[:, None, :1] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    height = np.broadcast_to(line[:, None, 1:], (*ring.shape[:2], 1))
    return np.concatenate([ring, height], axis=-1)


def _grid_surface(grid: Float[np.ndarray, "rows columns 3"], color: Color) -> Mesh:
    """Closed surface of a grid of points whose last column is joined to the first."""
    rows, columns = grid.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1], number[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    lower, upper = np.stack([a, a_next, b_next], -1), np.stack([a, b_next, b], -1)
    faces = np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])
    return solid(grid.reshape(-1, 3), faces, color)


def _box_grid(half: Point, spacing: float) -> tuple[Points, np.ndarray]:
    """Vertices and faces of a box about the origin, each side a regular grid."""
    vertices, faces, count = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        steps = ((end, max(1, int(np.ceil(2 * end / spacing)))) for end in (half[u], half[v]))
        along = (np.linspace(-end, end, parts + 1) for end, parts in steps)
        uu, vv = np.meshgrid(*along, indexing="ij")
        number = np.arange(uu.size).reshape(uu.shape)
        a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
        c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
        quads = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        for sign in (-1.0, 1.0):
            side = np.empty((uu.size, 3))
            side[:, axis], side[:, u], side[:, v] = sign * half[axis], uu.ravel(), vv.ravel()
            vertices.append(side)
            faces.append((quads if sign > 0 else quads[:, ::-1]) + count)
            count += uu.size
    return np.concatenate(vertices), np.concatenate(faces)


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
