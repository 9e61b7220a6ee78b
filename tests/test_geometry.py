"""Motions, cameras and rays: closed forms, and what must hold for every one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from generated_values import cameras, motions, numbers, point_sets, rotations, vectors
from hlp.geometry import (
    allocentric_to_egocentric,
    back_project,
    inverse,
    nearest_rotation,
    project,
    quaternions,
    rigid,
    rotation_distance,
    rotation_matrices,
    transform,
)

CAMERA = np.array([[572.4, 0.0, 325.3], [0.0, 573.6, 242.0], [0.0, 0.0, 1.0]])


def random_rotations(count, seed):
    return Rotation.random(count, random_state=seed).as_matrix()


def random_poses(count, seed):
    translations = np.random.default_rng(seed).normal(size=(count, 3))
    return rigid(random_rotations(count, seed), translations)


def test_transform_equals_homogeneous_multiplication():
    """Of points that all motions share, and of points of their own."""
    poses = random_poses(4, 2)
    points = np.random.default_rng(2).normal(size=(4, 9, 3))
    homogeneous = np.concatenate([points, np.ones((4, 9, 1))], axis=-1)
    expected = [(pose @ own.T).T[:, :3] for pose, own in zip(poses, homogeneous, strict=True)]
    np.testing.assert_allclose(transform(poses, points), expected, atol=1e-12)
    expected = [(pose @ homogeneous[0].T).T[:, :3] for pose in poses]
    np.testing.assert_allclose(transform(poses, points[0]), expected, atol=1e-12)


def test_projection_equals_the_camera_matrix():
    rng = np.random.default_rng(4)
    points = np.c_[rng.uniform(-0.4, 0.4, (20, 2)), rng.uniform(0.5, 2.0, 20)]
    homogeneous = points @ CAMERA.T
    pixels = project(points, CAMERA)
    np.testing.assert_allclose(pixels, homogeneous[:, :2] / homogeneous[:, 2:], rtol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 2.5, np.pi - 1e-6])
def test_rotation_distance_is_exact_also_at_both_ends(angle):
    first = random_rotations(5, 5)
    second = first @ Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    np.testing.assert_allclose(rotation_distance(first, second), angle, atol=1e-9)


def test_quaternions_keep_the_leading_dimensions_and_none_has_length_zero():
    rotations = random_rotations(6, 7).reshape(2, 3, 3, 3)
    quats = quaternions(rotations)
    assert quats.shape == (2, 3, 4)
    np.testing.assert_allclose(rotation_matrices(quats), rotations, atol=1e-12)
    with pytest.raises(ValueError, match="zero"):
        rotation_matrices(np.zeros((1, 4)))


def test_quaternions_and_matrices_are_scipys_to_the_last_bit():
    quats = np.random.default_rng(5).normal(size=(3000, 4))
    quats[:1000] = np.rint(quats[:1000])  # half turns and quarter turns, where components are equal
    quats = quats[np.linalg.norm(quats, axis=1) > 0.0]
    matrices = Rotation.from_quat(quats).as_matrix()
    np.testing.assert_array_equal(rotation_matrices(quats), matrices)
    expected = Rotation.from_matrix(matrices).as_quat()
    np.testing.assert_array_equal(quaternions(matrices), expected)


RAYS = st.builds(lambda xy, z: np.array([*xy, 1.0]) * z, vectors(-2.0, 2.0, 2), numbers(0.05, 9.0))


@given(RAYS, cameras())
def test_a_point_comes_back_from_its_pixel_and_depth(point, camera):
    pixel = project(point[None], camera)
    np.testing.assert_allclose(back_project(pixel, point[2:], camera)[0], point, atol=1e-12)


@given(vectors(-500.0, 2000.0, 2), numbers(0.01, 50.0), cameras())
def test_a_pixel_comes_back_from_its_point(pixel, depth, camera):
    point = back_project(pixel[None], np.array([depth]), camera)
    assert point[0, 2] == depth
    np.testing.assert_allclose(project(point, camera)[0], pixel, atol=1e-9)


@given(RAYS, numbers(0.1, 10.0), cameras())
def test_all_points_of_a_ray_have_one_pixel(point, factor, camera):
    near, far = project(np.stack([point, point * factor]), camera)
    np.testing.assert_allclose(near, far, atol=1e-8)


@given(motions(), motions(), motions(), point_sets())
def test_motions_are_a_group_that_keeps_distances(first, second, third, points):
    np.testing.assert_allclose(inverse(first) @ first, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(inverse(inverse(first)), first, atol=1e-12)
    np.testing.assert_allclose(
        inverse(first @ second), inverse(second) @ inverse(first), atol=1e-11
    )
    np.testing.assert_allclose(
        transform(first @ second @ third, points),
        transform(first, transform(second, transform(third, points))),
        atol=1e-11,
    )
    moved = transform(first, points)
    between = [np.linalg.norm(places[1:] - places[:-1], axis=1) for places in (points, moved)]
    np.testing.assert_allclose(*between, atol=1e-12)
    np.testing.assert_allclose(transform(inverse(first), moved), points, atol=1e-11)


@given(rotations(), rotations(), rotations())
def test_the_distance_of_rotations_is_a_metric_that_turning_both_keeps(first, second, third):
    distance = float(rotation_distance(first, second))
    assert 0.0 <= distance <= np.pi + 1e-12
    assert rotation_distance(first, first) < 1e-9
    np.testing.assert_allclose(rotation_distance(second, first), distance, atol=1e-12)
    for turned in (
        rotation_distance(third @ first, third @ second),
        rotation_distance(first @ third, second @ third),
    ):
        np.testing.assert_allclose(turned, distance, atol=2e-7)  # the arc sine is steep at π
    detour = rotation_distance(first, third) + rotation_distance(third, second)
    assert distance <= detour + 2e-7


@given(rotations(), vectors(-1e-3, 1e-3, 9))
def test_the_nearest_rotation_is_one_and_no_other_is_nearer(rotation, rounding):
    written = rotation + rounding.reshape(3, 3)
    nearest = nearest_rotation(written)
    np.testing.assert_allclose(nearest @ nearest.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(nearest) > 0
    assert np.linalg.norm(nearest - written) <= np.linalg.norm(rotation - written) + 1e-12
    np.testing.assert_allclose(nearest_rotation(nearest), nearest, atol=1e-12)
    mirrored = nearest_rotation(np.diag([1.0, 1.0, -0.2]))
    assert np.linalg.det(mirrored) > 0


@given(RAYS, numbers(0.1, 10.0))
def test_the_turn_to_a_ray_is_the_smallest_that_takes_the_axis_there(ray, length):
    unit, axis = ray / np.linalg.norm(ray), np.array([0.0, 0.0, 1.0])
    turn = allocentric_to_egocentric(ray[None] * length)[0]
    np.testing.assert_allclose(turn @ axis, unit, atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) > 0
    between = np.arctan2(np.linalg.norm(np.cross(axis, unit)), unit[2])
    np.testing.assert_allclose(rotation_distance(turn, np.eye(3)), between, atol=1e-9)
    # Its axis of rotation is at right angles to both.
    normal = np.cross(axis, unit)
    np.testing.assert_allclose(turn @ normal, normal, atol=1e-12)
