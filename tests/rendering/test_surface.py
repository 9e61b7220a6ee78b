"""Colours read from a grid of cells, and samples of a surface."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hlp.geometry import back_project, rotation_matrices
from hlp.records import Mesh, Texture
from hlp.rendering.surface import (
    broadest_side,
    color_grid,
    sample_surface,
    sample_texture,
    surface_and_normals,
)


def _box():
    """A box (m) whose sides, each with corners of its own, have six colours."""
    box = trimesh.creation.box((0.08, 0.10, 0.12))
    normals = np.repeat(box.face_normals, 3, axis=0)
    colors = np.rint(127.5 + 100 * normals @ np.diag([1.0, 0.6, 0.3])).astype(np.uint8)
    faces = np.arange(36).reshape(-1, 3)
    return Mesh(np.array(box.triangles.reshape(-1, 3)), faces, colors, normals)


def test_samples_are_on_the_surface_as_dense_everywhere():
    samples = sample_surface(_box(), 6000)
    half = np.array([0.04, 0.05, 0.06])
    on_side = np.abs(np.abs(samples.points) - half) < 1e-12
    assert on_side.any(axis=1).all() and (np.abs(samples.points) <= half + 1e-12).all()
    areas = np.array([0.1 * 0.12, 0.08 * 0.12, 0.08 * 0.1])
    for axis in range(3):
        share = on_side[:, axis].mean()
        assert abs(share - areas[axis] / areas.sum()) < 0.01
    np.testing.assert_allclose(np.linalg.norm(samples.normals, axis=1), 1.0)


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.0, 1.0), (0.2, -0.5, 0.1, 0.8)])
def test_the_broadest_side_of_a_box_is_its_largest_face(quaternion):
    turn = rotation_matrices(np.array([quaternion]))[0]
    box = _box()
    turned = replace(box, vertices=box.vertices @ turn.T + 0.3)
    assert broadest_side(turned) == pytest.approx(0.10 * 0.12, rel=0.03)


def test_the_grid_has_each_sides_colour_near_that_side():
    mesh = _box()
    grid = color_grid(mesh)
    for axis, half in enumerate((0.04, 0.05, 0.06)):
        for sign in (-1.0, 1.0):
            for off in (-0.002, 0.0, 0.002):
                point = np.full(3, 0.003)
                point[axis] = sign * (half + off)
                cell = np.floor((point - grid.corner) / grid.cell).astype(int)
                expected = np.full(3, 127.5)
                expected[axis] += sign * 100 * (1.0, 0.6, 0.3)[axis]
                assert np.abs(grid.colors[tuple(cell)] - expected).max() <= 1.5


def test_texels_are_where_opengl_has_them():
    image = np.arange(2 * 4 * 3, dtype=np.uint8).reshape(2, 4, 3) * 10
    centers = np.array([[0.125, 0.75], [0.875, 0.25], [0.375, 0.25]])
    texture = Texture(image, centers)
    np.testing.assert_allclose(
        sample_texture(texture, centers), [image[0, 0], image[1, 3], image[1, 1]]
    )
    between = sample_texture(texture, np.array([[0.25, 0.5]]))
    np.testing.assert_allclose(between[0], image[:, :2].reshape(-1, 3).mean(axis=0))
    np.testing.assert_allclose(
        sample_texture(texture, centers + np.array([1.0, -2.0])), sample_texture(texture, centers)
    )


def test_surface_and_normals_are_those_of_numpy_to_the_last_bit():
    rng = np.random.default_rng(4)
    camera = np.array([[520.0, 0.0, 19.5], [0.0, 520.0, 14.5], [0.0, 0.0, 1.0]])
    depth = rng.uniform(0.4, 0.8, (30, 40)).astype(np.float32)
    used = rng.random(depth.shape) < 0.6
    used[0, 3], used[5, 0], used[-1, 7], used[9, -1] = True, True, True, True
    surface, normals = surface_and_normals(depth, used, int(used.sum()), camera)
    rows, columns = np.indices(depth.shape)
    pixels = np.stack([columns, rows], axis=-1).astype(float)
    seen = back_project(pixels, depth.astype(float), camera)
    across, down = np.zeros_like(seen), np.zeros_like(seen)
    across[:, 1:-1] = seen[:, 2:] - seen[:, :-2]
    down[1:-1] = seen[2:] - seen[:-2]
    expected = np.cross(across, down)
    expected /= np.maximum(np.linalg.norm(expected, axis=-1, keepdims=True), 1e-12)
    np.testing.assert_array_equal(surface, seen[used])
    np.testing.assert_array_equal(normals, expected[used])
    assert np.linalg.norm(normals, axis=1).max() == pytest.approx(1.0)
