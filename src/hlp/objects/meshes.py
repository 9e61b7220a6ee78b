"""CAD models: loading with checks, decimation, diameter."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Int

from hlp.arrays import Points
from hlp.errors import ConfigError, DataError, MissingFileError
from hlp.objects.mesh_colors import (
    check_scale,
    files_beside,
    guess_scale,
    mesh_colors,
    plain_colors,
    with_one_kind_of_color,
)
from hlp.records import MILLIMETRE, MILLIMETRES_PER_METRE, Mesh

if TYPE_CHECKING:
    import trimesh

_MOST_PAIRS = 4_000_000  # distances at a time: 32 MB
_MANY = 20_000  # corners of a convex hull; above, comparing all pairs takes minutes
_DIRECTIONS = 1024
_VERY_LARGE = 200_000  # triangles; above, simplifying takes more memory than anything else
_MOST_FACES = 500_000  # finer than any camera shows; with more, a mesh is decimated when loaded
_KEPT_FACES = 100_000  # of such a mesh: 0.7 mm each of an object of 15 cm
_FINEST_GRID = 256  # cells along the longest side of a mesh: less than a millimetre of 20 cm
_LEAST_SURFACE = 1e-4  # of a mesh, in squares of its diameter; a rod of 1 : 1000 has 3e-3
_logger = logging.getLogger(__name__)


def load_mesh(path: Path, scale: float | None = MILLIMETRE) -> Mesh:
    """Load a triangle mesh; `scale` is metres per unit of the file (BOP's files are in mm).

    With `scale` None the unit is guessed from the size of the object, and logged. Vertices and
    faces keep their order; the parts of a scene are joined. Colours are the file's (per vertex, per
    face or texture) or light grey, also where the texture's image is missing, which is logged;
    normals are the file's or computed. A mesh of more than 500 000 triangles is decimated to
    100 000, which is logged. Raises FileNotFoundError, and ValueError for a file that cannot be
    parsed, has no triangles, NaN vertices or triangles of vertices that it lacks, or whose diameter
    is not 1 cm … 2 m (wrong unit).
    """
    import trimesh

    if not path.is_file():
        raise MissingFileError(f"no mesh {path}")
    missing: list[str] = []
    raw = _parsed(path, resolver=files_beside(path, missing))
    if missing:  # in place of the image trimesh would put up a stand-in
        _logger.warning("%s: its texture %s is missing: the object is grey", path, missing[0])
        raw = _parsed(path, skip_materials=True)
    if not isinstance(raw, trimesh.Trimesh) or len(raw.vertices) == 0 or len(raw.faces) == 0:
        raise DataError(f"{path} has no triangles: export it as a triangle mesh")
    vertices, faces, diameter = _checked(path, raw)
    if scale is None:
        scale = guess_scale(path, diameter)
    check_scale(path, diameter, scale)
    vertices *= scale
    colors, texture, stated = mesh_colors(path, raw) if not missing else plain_colors(raw)
    colored = stated and np.ptp(colors) > 0  # one grey is what modelling programs write for none
    large = len(faces) > _MOST_FACES  # its normals would take more memory than all else
    normals = np.zeros_like(vertices) if large else _unit_normals(np.array(raw.vertex_normals))
    mesh = Mesh(vertices, faces.astype(np.int32), colors, normals, texture, bool(colored))
    if not large:
        return mesh
    _logger.info("%s: %d triangles, decimated to %d", path, len(faces), _KEPT_FACES)
    return decimate(mesh, _KEPT_FACES)


def _parsed(path: Path, **options: Any) -> trimesh.Geometry:
    """What trimesh reads in a file, the parts of a scene joined. Raises DataError."""
    import trimesh

    level = trimesh.util.log.level
    trimesh.util.log.setLevel(logging.CRITICAL)  # it prints the tracebacks of errors that it raises
    try:
        # Numbers that no index can be are found later. `force="mesh"` would drop the normals.
        with np.errstate(all="ignore"):
            raw = trimesh.load(path, process=False, maintain_order=True, **options)
            return with_one_kind_of_color(raw).to_mesh() if isinstance(raw, trimesh.Scene) else raw
    except Exception as error:  # trimesh raises nearly every kind for broken files
        raise DataError(
            f"{path} cannot be read as a mesh ({str(error)[:200]}): export it again, as PLY or GLB"
        ) from error
    finally:
        trimesh.util.log.setLevel(level)


def _checked(path: Path, raw: trimesh.Trimesh) -> tuple[Points, Int[np.ndarray, "f 3"], float]:
    """Vertices, triangles and diameter. Raises DataError where they are none, or show nothing."""
    vertices = np.array(raw.vertices, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise DataError(f"{path} has vertices without three coordinates: export it again")
    if not np.isfinite(vertices).all():
        raise DataError(f"{path} has NaN or infinite vertices: repair the mesh")
    faces = np.array(raw.faces, dtype=np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise DataError(f"{path} has a triangle of a vertex that it lacks: export it again")
    diameter = mesh_diameter(vertices)
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    with np.errstate(all="ignore"):  # of sizes that no object has
        area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2.0
    if area < _LEAST_SURFACE * diameter**2:
        raise DataError(
            f"{path} has no surface: its {len(faces)} triangles are points or lines: repair the "
            "mesh, or export it again"
        )
    return vertices, faces, diameter


def decimate(mesh: Mesh, faces: int) -> Mesh:
    """The mesh reduced to at most `faces` triangles by quadric error; unchanged if it has no more.

    Colours are those of the nearest vertex of the full mesh; the result has no texture. Normals are
    computed from the new triangles, because the nearest vertex may be on the other side of a thin
    wall. Raises ValueError for fewer than 4 faces, or if no triangle is left.
    """
    from scipy.spatial import cKDTree

    if faces < 4:
        raise ConfigError(f"a decimated mesh needs at least 4 faces, not {faces}")
    if len(mesh.faces) <= faces:
        return mesh
    points, kept = _simplified(mesh, faces)
    if len(kept) == 0:
        raise DataError(f"decimating {len(mesh.faces)} triangles to {faces} leaves none")
    vertices = np.asarray(points, dtype=np.float64) / MILLIMETRES_PER_METRE
    _, nearest = cKDTree(mesh.vertices).query(vertices)
    kept = np.asarray(kept, dtype=np.int32)
    normals = _vertex_normals(vertices, kept)
    return Mesh(vertices, kept, mesh.colors[nearest], normals, colored=mesh.colored)


def _simplified(mesh: Mesh, faces: int) -> tuple[Points, Int[np.ndarray, "g 3"]]:
    """At most `faces` triangles by quadric error, and their vertices in millimetres.

    The library stops early at many open edges or coplanar triangles. Then, and where a mesh is very
    large, vertices are merged beforehand in the cells of a grid, as fine as possible.
    """
    import fast_simplification

    # In millimetres, because in metres details are as small as the library's tolerances.
    if len(mesh.faces) <= _VERY_LARGE:
        # Meshes without shared vertices (STL, textured OBJ) would fall apart: merge equal ones.
        welded, index = np.unique(mesh.vertices, axis=0, return_inverse=True)
        triangles = index.reshape(-1)[mesh.faces].astype(np.int32)
        points = (welded * MILLIMETRES_PER_METRE).astype(np.float32)
        points, kept = fast_simplification.simplify(points, triangles, target_count=faces)
        if len(kept) <= faces:
            return points, kept
    points = (mesh.vertices * MILLIMETRES_PER_METRE).astype(np.float32)
    cells = _FINEST_GRID
    while True:
        coarse, triangles = _merged(points, mesh.faces, cells)
        if len(triangles) > faces:
            coarse, triangles = fast_simplification.simplify(coarse, triangles, target_count=faces)
        if len(triangles) <= faces:
            return coarse, triangles
        cells //= 2


def _merged(
    points: Points, triangles: Int[np.ndarray, "f 3"], cells: int
) -> tuple[Points, Int[np.ndarray, "g 3"]]:
    """Vertices of one cell of a grid made one, at their mean; triangles that are none left out.

    `cells` is the number of cells along the longest side of the bounding box.
    """
    low = points.min(axis=0)
    side = float(np.ptp(points, axis=0).max()) / max(cells, 1)
    grid = np.floor((points - low) / side).astype(np.int64)
    # One number for each cell: sorting numbers is ten times faster than sorting rows.
    cell = np.ravel_multi_index(tuple(grid.T), tuple(grid.max(axis=0) + 1))
    _, index, count = np.unique(cell, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(index, points[:, axis]) for axis in range(3)], axis=1)
    corners = index[triangles]
    a, b, c = corners.T
    kept = corners[(a != b) & (b != c) & (c != a)]
    alike = np.ravel_multi_index(tuple(np.sort(kept, axis=1).T), (len(count),) * 3)
    _, first = np.unique(alike, return_index=True)
    means = (sums / count[:, None]).astype(np.float32)
    return means, kept[np.sort(first)].astype(np.int32)


def mesh_diameter(vertices: Points) -> float:
    """Largest distance between two vertices (m), computed on the convex hull.

    Of a hull of more than 20 000 corners, those farthest in 1024 directions are compared: the
    result is at most 0.1 % too small.
    """
    from scipy.spatial import ConvexHull, QhullError
    from scipy.spatial.distance import cdist

    if len(vertices) > _VERY_LARGE:
        vertices = _farthest(vertices)
    try:
        corners = vertices[ConvexHull(vertices).vertices]
    except QhullError:  # flat or tiny: use all vertices
        corners = np.unique(vertices, axis=0)
    if len(corners) > _MANY:
        corners = _farthest(corners)
    block = max(1, _MOST_PAIRS // len(corners))
    blocks = (corners[i : i + block] for i in range(0, len(corners), block))
    return max(float(cdist(block, corners).max()) for block in blocks)


def _farthest(points: Points) -> Points:
    """The points that lie farthest in directions spread over the sphere."""
    along = (points @ direction for direction in hemisphere(_DIRECTIONS))
    return np.asarray(points[np.unique([(way.argmin(), way.argmax()) for way in along])])


def hemisphere(count: int) -> Points:
    """Directions spread evenly over the upper hemisphere (Fibonacci's spiral)."""
    index = np.arange(count) + 0.5
    z = index / count
    angle = index * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def _vertex_normals(vertices: Points, faces: Int[np.ndarray, "f 3"]) -> Points:
    """Normals weighted by the areas of the triangles around each vertex."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(total, faces[:, corner], area)
    return _unit_normals(total)


def _unit_normals(normals: Points) -> Points:
    """Normals at unit length; +z for vertices without a triangle of positive area."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    up = np.array([0.0, 0.0, 1.0])
    return np.asarray(np.where(usable, normals / np.where(usable, length, 1.0), up))
