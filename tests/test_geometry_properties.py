"""What must hold for every motion, camera and ray."""

import numpy as np
from hypothesis import assume, given
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
    rotation_distance,
    rotation_matrices,
    transform,
)

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


@given(rotations(), vectors(-1.0, 1.0), numbers(0.0, np.pi))
def test_the_distance_is_the_angle_that_was_turned(rotation, axis, angle):
    assume(np.linalg.norm(axis) > 0.1)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
    np.testing.assert_allclose(rotation_distance(turn @ rotation, rotation), angle, atol=1e-7)


@given(rotations(), numbers(0.01, 100.0))
def test_a_rotation_comes_back_from_either_of_its_quaternions(rotation, length):
    quaternion = quaternions(rotation)
    for same in (quaternion, -quaternion, quaternion * length):
        np.testing.assert_allclose(rotation_matrices(same), rotation, atol=1e-12)


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
