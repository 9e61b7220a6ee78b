"""The mesh that poses are drawn with shows the same object as the full one."""

import numpy as np
import pytest
import trimesh

from hlp.errors import ConfigError
from hlp.objects.meshes import mesh_diameter
from hlp.objects.proxy import build_proxy
from hlp.rendering.rasterizer import render_depth
from refinement_scene import as_mesh


def perforated_plate() -> trimesh.Trimesh:
    """A plate with many round holes: large flat faces, most triangles on the holes' walls."""
    parts = []
    for x in range(8):
        for y in range(5):
            ring = trimesh.creation.annulus(r_min=0.004, r_max=0.0065, height=0.01, sections=24)
            ring.apply_translation((0.0125 * x, 0.0125 * y, 0.0))
            parts.append(ring)
    return trimesh.util.concatenate(parts)


def silhouettes(mesh, diameter: float) -> np.ndarray:
    camera = np.array([[1000.0, 0, 60], [0, 1000.0, 60], [0, 0, 1]])
    turn = trimesh.transformations.rotation_matrix
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    poses = []
    for angle in (0.0, 0.5, 1.0):
        pose = turn(angle, [1, 0.3, 0])
        pose[:3, 3] = [0, 0, 10 * diameter] - pose[:3, :3] @ middle
        poses.append(pose)
    return render_depth(mesh, np.array(poses), camera, (120, 120)) > 0


def test_a_part_of_many_small_features_keeps_them() -> None:
    mesh = as_mesh(perforated_plate())
    diameter = mesh_diameter(mesh.vertices)
    proxy = build_proxy(mesh, 200, diameter)
    assert 200 < len(proxy.faces) < len(mesh.faces)
    full, drawn = silhouettes(mesh, diameter), silhouettes(proxy, diameter)
    assert (full & drawn).sum() > 0.85 * (full | drawn).sum()


def test_a_smooth_surface_needs_no_more_triangles_than_are_asked_for() -> None:
    mesh = as_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.05))
    assert len(build_proxy(mesh, 500, 0.1).faces) <= 500


def test_a_mesh_of_few_triangles_stays_and_too_few_are_refused() -> None:
    mesh = as_mesh(trimesh.creation.box((0.1, 0.05, 0.02)))
    assert build_proxy(mesh, 500, 0.12) is mesh
    with pytest.raises(ConfigError, match="at least 4 faces"):
        build_proxy(mesh, 3, 0.12)
