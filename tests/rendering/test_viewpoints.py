"""Viewpoints reach the known optima of the Thomson problem; the cameras look where they should."""

import numpy as np
import pytest

from hlp.rendering.views import hemisphere, thomson, view_rotations

# Lowest known energies: Wales & Ulker, Physical Review B 74 (2006), 212101.
BEST_ENERGY = {
    2: 0.5,
    4: 3.674234614,
    12: 49.165253058,
    32: 412.261274651,
}


def coulomb_energy(points):
    """Electrostatic energy Σ_{i<j} 1/|p_i − p_j| of unit charges at `points` (n, 3)."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return float((1.0 / distance[np.triu_indices(len(points), k=1)]).sum())


@pytest.mark.parametrize("count", BEST_ENERGY)
def test_thomson_reaches_the_known_optimum(count):
    points = thomson(count, seed=3)
    assert points.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-12)
    best = BEST_ENERGY[count]
    assert best * (1 - 1e-8) <= coulomb_energy(points) <= best * 1.005


@pytest.mark.parametrize("count", [1, 2, 10, 100])
def test_hemisphere_is_the_upper_half_of_an_even_sphere(count):
    upper = hemisphere(count, seed=1)
    assert upper.shape == (count, 3)
    assert (upper[:, 2] > 0).all()
    whole = np.concatenate([upper, upper * [1, 1, -1]])
    assert coulomb_energy(whole) < 1.05 * coulomb_energy(thomson(2 * count, seed=1))


def test_too_few_viewpoints_are_refused():
    with pytest.raises(ValueError, match="at least 1"):
        thomson(0, seed=0)
    with pytest.raises(ValueError, match="at least 1"):
        hemisphere(0, seed=0)


def test_cameras_look_at_the_object_the_right_way_up():
    viewpoints = thomson(30, seed=2)
    rotations = view_rotations(viewpoints, np.zeros(1))
    identity = np.broadcast_to(np.eye(3), (30, 3, 3))
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    # The camera stands along its own -z, seen from the object.
    np.testing.assert_allclose(rotations.swapaxes(1, 2) @ [0, 0, -1], viewpoints, atol=1e-12)
    up_in_camera = rotations @ [0, 0, 1]
    assert (up_in_camera[:, 1] < 0).all()  # image y points down
    np.testing.assert_allclose(up_in_camera[:, 0], 0.0, atol=1e-12)


def test_cameras_at_the_poles():
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    rotations = view_rotations(poles, np.zeros(1))
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_allclose(rotations.swapaxes(1, 2) @ [0, 0, -1], poles, atol=1e-12)
    np.testing.assert_allclose(rotations @ [0, 1, 0], [[0, -1, 0]] * 2, atol=1e-12)


def test_in_plane_angles_turn_the_image_viewpoint_by_viewpoint():
    viewpoints = thomson(3, seed=0)
    angles = np.array([-0.4, 0.0, 0.7])
    rotations = view_rotations(viewpoints, angles)
    upright = view_rotations(viewpoints, np.zeros(1))
    assert rotations.shape == (9, 3, 3)
    for viewpoint in range(3):
        for step, angle in enumerate(angles):
            turned = rotations[3 * viewpoint + step]
            # An image direction (x, y) of the upright view goes to the same, turned by the angle.
            x, y, z = upright[viewpoint] @ [0.2, -0.5, 0.3]
            cosine, sine = np.cos(angle), np.sin(angle)
            np.testing.assert_allclose(
                turned @ [0.2, -0.5, 0.3], [cosine * x - sine * y, sine * x + cosine * y, z]
            )
