import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from hlp.studies.basin import perturbed_poses

TRUE = rigid(Rotation.from_euler("xyz", [0.4, 0.2, 0.1]).as_matrix(), np.array([0.1, 0.0, 0.8]))
CENTROID = np.array([0.03, -0.02, 0.05])


def centre(pose):
    return pose[:3, :3] @ CENTROID + pose[:3, 3]


def test_errors_have_the_stated_sizes_about_the_centroid():
    degrees, millimetres = np.array([0.0, 0.0, 10.0, 30.0, 170.0]), np.array([0.0, 5, 0, 20, 60])
    starts = perturbed_poses(TRUE, CENTROID, degrees, millimetres, np.random.default_rng(0))
    for start, turn, shift in zip(starts, degrees, millimetres, strict=True):
        between = Rotation.from_matrix(start[:3, :3] @ TRUE[:3, :3].T)
        assert np.rad2deg(between.magnitude()) == pytest.approx(turn, abs=1e-6)
        apart = np.linalg.norm(centre(start) - centre(TRUE)) * 1000.0
        assert apart == pytest.approx(shift, abs=1e-9)
    np.testing.assert_allclose(starts[0], TRUE, atol=1e-12)


def test_directions_favour_none_and_differ():
    count = 4000
    starts = perturbed_poses(
        TRUE, CENTROID, np.full(count, 20.0), np.full(count, 10.0), np.random.default_rng(1)
    )
    shifts = np.array([centre(start) - centre(TRUE) for start in starts]) * 100.0
    axes = Rotation.from_matrix(starts[:, :3, :3] @ TRUE[:3, :3].T).as_rotvec() / np.deg2rad(20.0)
    for directions in (shifts, axes):
        # Uniform on the sphere: mean 0, and the mean of the outer products a third of the identity.
        np.testing.assert_allclose(directions.mean(axis=0), 0.0, atol=0.04)
        np.testing.assert_allclose(directions.T @ directions / count, np.eye(3) / 3, atol=0.03)
    assert abs(np.einsum("ni,ni->n", shifts, axes).mean()) < 0.05


def test_equal_seeds_give_equal_starts():
    def drawn(seed):
        rng = np.random.default_rng(seed)
        return perturbed_poses(TRUE, CENTROID, np.full(3, 9.0), np.full(3, 9.0), rng)

    np.testing.assert_array_equal(drawn(3), drawn(3))
    assert not np.allclose(drawn(3), drawn(4))
