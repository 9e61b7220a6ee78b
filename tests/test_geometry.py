import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp import geometry

CAMERA = np.array([[572.4, 0.0, 325.3], [0.0, 573.6, 242.0], [0.0, 0.0, 1.0]])


def random_rotations(count, seed):
    return Rotation.random(count, random_state=seed).as_matrix()


def random_poses(count, seed):
    translations = np.random.default_rng(seed).normal(size=(count, 3))
    return geometry.rigid(random_rotations(count, seed), translations)


def test_rigid_broadcasts_rotations_and_translations():
    rotation = random_rotations(1, 0)[0]
    translations = np.arange(6.0).reshape(2, 3)
    motions = geometry.rigid(rotation, translations)
    assert motions.shape == (2, 4, 4)
    for motion, translation in zip(motions, translations, strict=True):
        expected = np.eye(4)
        expected[:3, :3], expected[:3, 3] = rotation, translation
        np.testing.assert_array_equal(motion, expected)


def test_transform_equals_homogeneous_multiplication():
    poses = random_poses(4, 2)
    points = np.random.default_rng(2).normal(size=(9, 3))
    homogeneous = np.c_[points, np.ones(9)]
    expected = np.stack([(pose @ homogeneous.T).T[:, :3] for pose in poses])
    np.testing.assert_allclose(geometry.transform(poses, points), expected, atol=1e-12)
    np.testing.assert_allclose(geometry.transform(poses[0], points), expected[0], atol=1e-12)


def test_transform_takes_points_of_their_own_for_each_motion():
    poses = random_poses(4, 3)
    points = np.random.default_rng(3).normal(size=(4, 2, 3))
    moved = geometry.transform(poses, points)
    for i in range(4):
        np.testing.assert_allclose(moved[i], geometry.transform(poses[i], points[i]))


def test_projection_equals_the_camera_matrix():
    rng = np.random.default_rng(4)
    points = np.c_[rng.uniform(-0.4, 0.4, (20, 2)), rng.uniform(0.5, 2.0, 20)]
    homogeneous = points @ CAMERA.T
    pixels = geometry.project(points, CAMERA)
    np.testing.assert_allclose(pixels, homogeneous[:, :2] / homogeneous[:, 2:], rtol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, np.pi - 1e-6])
def test_rotation_distance_is_exact_at_both_ends(angle):
    first = random_rotations(5, 5)
    second = first @ Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    np.testing.assert_allclose(geometry.rotation_distance(first, second), angle, atol=1e-9)


def test_quaternions_keep_the_leading_dimensions_and_none_has_length_zero():
    rotations = random_rotations(6, 7).reshape(2, 3, 3, 3)
    quats = geometry.quaternions(rotations)
    assert quats.shape == (2, 3, 4)
    np.testing.assert_allclose(geometry.rotation_matrices(quats), rotations, atol=1e-12)
    with pytest.raises(ValueError, match="zero"):
        geometry.rotation_matrices(np.zeros((1, 4)))


def test_quaternions_and_matrices_are_scipys_to_the_last_bit():
    quats = np.random.default_rng(5).normal(size=(3000, 4))
    quats[:1000] = np.rint(quats[:1000])  # half turns and quarter turns, where components are equal
    quats = quats[np.linalg.norm(quats, axis=1) > 0.0]
    matrices = Rotation.from_quat(quats).as_matrix()
    np.testing.assert_array_equal(geometry.rotation_matrices(quats), matrices)
    expected = Rotation.from_matrix(matrices, assume_valid=True).as_quat()
    np.testing.assert_array_equal(geometry.quaternions(matrices), expected)
