"""Bins in the scenes of score calibration."""

from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid, transform
from hlp.method.learn.calibration_bins import bin_walls, copies, resting_plane, with_random_color
from hlp.records import ObjectModel
from refinement_scene import as_mesh


def plate():
    mesh = as_mesh(trimesh.creation.box((0.12, 0.08, 0.01)))
    return ObjectModel(1, "plate", mesh, mesh, 0.145, np.eye(4)[None], 0.1, 0.04)


def random_case(model, rng):
    """A random pose, and a plane that the object then lies on."""
    rotation = Rotation.random(random_state=rng).as_matrix()
    pose = rigid(rotation, np.array([0.1, -0.05, 0.7]) - rotation @ model.centroid)
    plane = resting_plane(model, pose, rng)
    assert plane is not None
    return pose, plane


def test_a_plate_lies_on_a_face_mostly_on_a_large_one():
    model, rng = plate(), np.random.default_rng(0)
    flat = 0
    for _ in range(60):
        pose, (normal, offset) = random_case(model, rng)
        heights = transform(pose, model.mesh.vertices) @ normal - offset
        assert np.isclose(heights, 0.0, atol=1e-9).sum() >= 4 and heights.min() > -1e-9
        assert normal @ pose[:3, 3] < 0.0
        flat += heights.max() < 0.011
    assert flat > 40


def test_more_of_the_object_lie_beside_it_and_walls_around_it():
    model, rng = plate(), np.random.default_rng(1)
    for _ in range(20):
        pose, plane = random_case(model, rng)
        center = transform(pose, model.centroid[None])[0]
        others = copies(model.mesh, model, pose, plane, rng)
        places = [center, *(transform(at, model.centroid[None])[0] for _, at in others)]
        apart = [np.linalg.norm(a - b) for i, a in enumerate(places) for b in places[:i]]
        assert min(apart, default=1.0) >= 0.69 * model.diameter
        for mesh, at in others:
            heights = transform(at, mesh.vertices) @ plane[0] - plane[1]
            assert abs(heights.min()) < 1e-9
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
