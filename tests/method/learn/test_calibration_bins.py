"""Bins in the scenes of score calibration."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from hlp.geometry import transform
from hlp.method.learn.calibration_bins import bin_walls, copies, lying, with_random_color
from refinement_scene import as_mesh, model_of, posed


def plate():
    return model_of(trimesh.creation.box((0.12, 0.08, 0.01)))


def random_case(model, rng):
    """A random pose, that in which the object then lies on a plane, and the plane."""
    rotation = Rotation.random(random_state=rng).as_matrix()
    before = posed(model, rotation, np.array([0.1, -0.05, 0.7]))
    return before, *lying(model, before, rng)


def test_a_plate_lies_where_it_was_mostly_on_a_large_face_and_a_side_that_was_seen_is_in_front():
    model, rng = plate(), np.random.default_rng(0)
    flat = 0
    for _ in range(60):
        before, pose, (normal, offset) = random_case(model, rng)
        heights = transform(pose, model.mesh.vertices) @ normal - offset
        assert np.isclose(heights, 0.0, atol=1e-9).sum() >= 4 and heights.min() > -1e-9
        assert normal @ pose[:3, 3] < 0.0
        flat += heights.max() < 0.011
        assert np.allclose(transform(pose, model.centroid[None]), [0.1, -0.05, 0.7])
        sides = pose[:3, :3].T @ normal
        axis = np.abs(sides).argmax()
        assert sides[axis] * (before[:3, axis] @ [-0.1, 0.05, -0.7]) > 0.0
    assert flat > 40


def gap(model, first, second):
    """The widest gap beside the first box's sides, of their size; negative where they overlap."""
    size = np.ptp(model.mesh.vertices, axis=0)
    corners = transform(np.linalg.inv(first) @ second, model.mesh.vertices) / size
    return np.maximum(corners.min(axis=0), -corners.max(axis=0)).max() - 0.5


def test_more_of_the_object_lie_beside_it_packed_or_apart():
    model, rng = plate(), np.random.default_rng(1)
    packed = 0
    for _ in range(40):
        _, pose, plane = random_case(model, rng)
        others = copies(model.mesh, model, pose, plane, rng)
        for mesh, at in others:
            assert abs((transform(at, mesh.vertices) @ plane[0] - plane[1]).min()) < 1e-9
        poses = [pose, *(at for _, at in others)]
        for first, second in permutations(poses, 2):
            assert max(gap(model, first, second), gap(model, second, first)) > -0.1
        near = [np.linalg.norm(at[:3, 3] - pose[:3, 3]) for at in poses[1:]]
        packed += min(near, default=1.0) < 0.99 * model.diameter
    assert 10 < packed < 35


def test_walls_stand_around_it():
    model, rng = plate(), np.random.default_rng(1)
    for _ in range(20):
        _, pose, plane = random_case(model, rng)
        center = transform(pose, model.centroid[None])[0]
        walls = bin_walls(model, center, plane, rng)
        assert len(walls) == 4
        for mesh, at in walls:
            corners = transform(at, mesh.vertices)
            assert abs((corners @ plane[0] - plane[1]).min()) < 1e-9
            assert np.linalg.norm(corners - center, axis=1).min() > 0.5 * model.diameter


def test_only_an_object_without_colours_is_painted():
    mesh, rng = as_mesh(trimesh.creation.box((1, 1, 1))), np.random.default_rng(2)
    assert with_random_color(mesh, rng) is mesh
    painted = with_random_color(replace(mesh, colored=False), rng)
    assert len(np.unique(painted.colors, axis=0)) == 1
    assert not np.array_equal(painted.colors, mesh.colors)
