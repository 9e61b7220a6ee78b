"""Errors by their definitions, and what must hold of them; see also test_toolkit_values.py."""

import dataclasses

import numpy as np
import pytest
from boxes import box_model
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from generated_values import motions, point_sets, poses_in_front, turns_about_z
from hlp.evaluation import EvaluationSettings, errors
from hlp.evaluation.errors import is_symmetric_flip, near_truth, rotation_error
from hlp.geometry import (
    inverse,
    nearest_symmetric_pose,
    project,
    rigid,
    rotation_distance,
    transform,
)

K = np.array([[572.4, 0.0, 325.3], [0.0, 573.6, 242.0], [0.0, 0.0, 1.0]])


def _poses(seed, spread=0.3):
    rng = np.random.default_rng(seed)
    true = rigid(Rotation.random(random_state=rng).as_matrix(), np.array([0.05, -0.03, 0.9]))
    step = rigid(Rotation.from_rotvec(rng.normal(0, spread, 3)).as_matrix(), rng.normal(0, 0.01, 3))
    return true @ step, true, rng.uniform(-0.06, 0.06, (150, 3))


def test_box_iou_is_that_of_boxes_computed_one_by_one():
    estimated, true, vertices = _poses(3)
    estimated[:2, 3] += 0.02
    boxes = []
    for pose in (estimated, true):
        pixels = project(transform(pose, vertices), K)
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


def test_mspd_of_a_pose_across_the_camera_is_infinite():
    behind, true, vertices = _poses(7)
    behind[2, 3] = 0.0
    assert errors.mspd(behind, true, vertices, np.eye(4)[None], K) == float("inf")


def test_vsd_is_one_where_nothing_is_visible():
    """For all else see the tests of BOP's recalls."""
    wall = np.full((24, 30), 0.5)
    np.testing.assert_array_equal(errors.vsd(0 * wall, wall + 0.4, wall, K, [0.02]), [1.0])


SETTINGS = EvaluationSettings(symmetric=("bar",))
HALF_TURN = rigid(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
TRUE = rigid(Rotation.from_rotvec([0.4, 0.2, 0.1]).as_matrix(), np.array([0.05, 0.0, 0.8]))
CENTER = (0.2, 0.0, 0.0)  # of the bars, beside their origin
SHIFT, BACK = (rigid(np.eye(3), sign * np.array(CENTER)) for sign in (1.0, -1.0))
BAR_TURN = SHIFT @ HALF_TURN @ BACK
PLAIN = box_model((0.02, 0.04, 0.12), center=CENTER)
BAR = box_model(
    (0.02, 0.04, 0.12), name="bar", symmetries=np.stack([np.eye(4), BAR_TURN]), center=CENTER
)


def _turned(degrees, millimetres=0.0, axis=(0.0, 1.0, 0.0)):
    """The true pose turned about the object's centroid, then moved."""
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis)).as_matrix()
    pose = TRUE @ SHIFT @ rigid(turn, np.zeros(3)) @ BACK
    pose[0, 3] += millimetres / 1000.0
    return pose


def test_the_turned_pose_of_a_symmetric_object_is_near_only_by_the_policy():
    poses = np.stack([TRUE, TRUE @ BAR_TURN, _turned(90)])
    centroids = transform(poses, BAR.centroid[None])[:, 0]
    strict = dataclasses.replace(SETTINGS, symmetric=())
    for settings, turned in ((SETTINGS, True), (strict, False)):
        near = near_truth(poses[:, :3, :3], centroids, TRUE, BAR, settings, (5.0, 5.0))
        assert near.tolist() == [True, turned, False]


def test_votes_near_the_truth_are_those_that_angles_and_distances_say(monkeypatch):
    rng = np.random.default_rng(0)
    turns = Rotation.from_rotvec(rng.normal(scale=0.25, size=(200, 3)))
    rotations = turns.as_matrix() @ TRUE[:3, :3]
    center = TRUE[:3, :3] @ PLAIN.centroid + TRUE[:3, 3]
    centroids = center + rng.normal(scale=0.012, size=(200, 3))
    near = near_truth(rotations, centroids, TRUE, PLAIN, SETTINGS, (15.0, 20.0))
    expected = (turns.magnitude() <= np.deg2rad(15.0)) & (
        np.sqrt(((centroids - center) ** 2).sum(axis=1)) <= 0.02
    )
    assert 20 < expected.sum() < 150
    np.testing.assert_array_equal(near, expected)
    monkeypatch.setattr("hlp.evaluation.errors._MOTIONS", 1)  # a symmetric pose at a time
    turned = near_truth(rotations @ BAR_TURN[:3, :3], centroids, TRUE, BAR, SETTINGS, (15.0, 20.0))
    np.testing.assert_array_equal(turned, expected)
    none = near_truth(np.zeros((0, 3, 3)), np.zeros((0, 3)), TRUE, BAR, SETTINGS, (15.0, 20.0))
    assert none.shape == (0,)


@pytest.mark.parametrize(
    ("pose", "model", "flipped"),
    [
        (_turned(180, axis=(0.0, 0.0, 1.0)), PLAIN, True),
        (_turned(90), PLAIN, False),  # the bar lies across
        (_turned(20, axis=(0.0, 0.0, 1.0)), PLAIN, False),  # within the basin
        (_turned(180, 40, axis=(0.0, 0.0, 1.0)), PLAIN, False),  # elsewhere
        (_turned(180, axis=(0.0, 0.0, 1.0)), BAR, False),  # that one is right
    ],
)
def test_flipped_is_what_lies_on_the_surface_but_is_turned(pose, model, flipped):
    assert is_symmetric_flip(pose, TRUE, model, SETTINGS) == flipped


@st.composite
def symmetric_objects(draw):
    """Vertices and the cyclic group of 2 to 6 motions, about any axis, that maps them to them."""
    place = draw(motions(0.02))
    group = place @ turns_about_z(draw(st.integers(2, 6))) @ inverse(place)
    part = draw(point_sets(1, 12))
    return np.concatenate([transform(each, part) for each in group]), group


@given(poses_in_front(), poses_in_front(), symmetric_objects())
def test_the_nearest_symmetric_pose_is_a_sibling_and_none_is_nearer(estimated, true, thing):
    _, group = thing
    nearest = nearest_symmetric_pose(estimated, true, group)
    siblings = true @ group
    assert np.abs(siblings - nearest).max(axis=(1, 2)).min() < 1e-12
    distances = rotation_distance(estimated[None, :3, :3], siblings[:, :3, :3])
    assert rotation_error(estimated, nearest) <= distances.min() + 1e-12
