"""Errors against plain loops over their definitions."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hlp.evaluation import errors
from hlp.geometry import rigid

K = np.array([[572.4, 0.0, 325.3], [0.0, 573.6, 242.0], [0.0, 0.0, 1.0]])


def _poses(seed, spread=0.3):
    rng = np.random.default_rng(seed)
    true = rigid(Rotation.random(random_state=rng).as_matrix(), np.array([0.05, -0.03, 0.9]))
    step = rigid(Rotation.from_rotvec(rng.normal(0, spread, 3)).as_matrix(), rng.normal(0, 0.01, 3))
    return true @ step, true, rng.uniform(-0.06, 0.06, (150, 3))


def _at(pose, vertex):
    return pose[:3, :3] @ vertex + pose[:3, 3]


def _pixel(pose, vertex):
    x, y, z = _at(pose, vertex)
    return np.array([K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]])


@pytest.mark.parametrize("seed", [0, 1])
def test_add_and_adi_are_means_of_distances_computed_one_by_one(seed):
    estimated, true, vertices = _poses(seed)
    add = np.mean([np.linalg.norm(_at(estimated, v) - _at(true, v)) for v in vertices])
    assert errors.add(estimated, true, vertices) == pytest.approx(add, rel=1e-10)
    moved = [_at(estimated, v) for v in vertices]
    adi = np.mean([min(np.linalg.norm(_at(true, v) - m) for m in moved) for v in vertices])
    assert errors.add_s(estimated, true, vertices) == pytest.approx(adi, rel=1e-10)
    assert errors.add_s(estimated, true, vertices, cKDTree(vertices)) == pytest.approx(adi)
    assert adi < add


def test_adi_starts_from_the_true_vertices():
    # Two far vertices and a cluster: from which side the closest is sought changes the mean.
    vertices = np.array([[0.0, 0, 0], [0.001, 0, 0], [0.002, 0, 0], [0.1, 0, 0]])
    true, estimated = np.eye(4), np.eye(4)
    estimated[0, 3] = 0.1
    # From the true side: 0.1, 0.099, 0.098 to the estimated cluster at 0.1, and 0 for the last.
    assert errors.add_s(estimated, true, vertices) == pytest.approx((0.1 + 0.099 + 0.098) / 4)
    # The other way round it would be 0, 0.001, 0.002 and 0.1.
    assert errors.add_s(true, estimated, vertices) == pytest.approx((0.001 + 0.002 + 0.1) / 4)


@pytest.mark.parametrize("degrees", [0.01, 5.0, 179.99])
def test_errors_of_a_turn_and_of_a_shift(degrees):
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis).as_matrix()
    start = Rotation.random(random_state=4).as_matrix()
    pose, moved = rigid(start, np.zeros(3)), rigid(turn @ start, np.array([0.0, 0.007, 0.0]))
    assert np.rad2deg(errors.rotation_error(moved, pose)) == pytest.approx(degrees, rel=1e-5)
    assert errors.translation_error(moved, pose) == pytest.approx(0.007)


def test_box_iou_is_that_of_boxes_computed_one_by_one():
    estimated, true, vertices = _poses(3)
    estimated[:2, 3] += 0.02
    boxes = []
    for pose in (estimated, true):
        pixels = np.array([_pixel(pose, v) for v in vertices])
        boxes.append([*pixels.min(axis=0), *pixels.max(axis=0)])
    a, b = boxes
    width, height = (min(a[i + 2], b[i + 2]) - max(a[i], b[i]) for i in (0, 1))
    shared = max(width, 0) * max(height, 0)
    reference = shared / (sum((x[2] - x[0]) * (x[3] - x[1]) for x in boxes) - shared)
    assert 0 < reference < 1
    assert errors.box_iou(estimated, true, vertices, K) == pytest.approx(reference, rel=1e-9)
    away, behind = true.copy(), true.copy()
    away[0, 3] += 1.0
    behind[2, 3] = -0.9
    found = [errors.box_iou(pose, true, vertices, K) for pose in (true, away, behind)]
    assert found == [pytest.approx(1.0), 0.0, 0.0]
    assert errors.box_iou(true, behind, vertices, K) == 0.0


@pytest.mark.parametrize("steps", [1, 4])
def test_mssd_and_mspd_equal_loops_over_symmetries_and_vertices(steps):
    estimated, true, vertices = _poses(7)
    angles = np.arange(steps)[:, None] * 2 * np.pi / steps * np.array([0.0, 0.0, 1.0])
    turns = rigid(Rotation.from_rotvec(angles).as_matrix(), np.zeros(3))
    surface, pixels = (
        min(
            max(np.linalg.norm(place(estimated, v) - place(true @ turn, v)) for v in vertices)
            for turn in turns
        )
        for place in (_at, _pixel)
    )
    assert errors.mssd(estimated, true, vertices, turns) == pytest.approx(surface)
    assert errors.mspd(estimated, true, vertices, turns, K) == pytest.approx(pixels)
    assert errors.mssd(true @ turns[-1], true, vertices, turns) == pytest.approx(0, abs=1e-12)
    behind = true.copy()
    behind[2, 3] = 0.0
    assert errors.mspd(behind, true, vertices, turns, K) == float("inf")


def test_vsd_is_one_where_nothing_is_visible():
    """For all else see the tests of BOP's recalls."""
    wall = np.full((24, 30), 0.5)
    np.testing.assert_array_equal(errors.vsd(0 * wall, wall + 0.4, wall, K, [0.02]), [1.0])
