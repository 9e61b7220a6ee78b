import dataclasses

import numpy as np
import pytest
from boxes import box_model
from scipy.spatial.transform import Rotation

from hlp.evaluation import EvaluationSettings
from hlp.evaluation.errors import is_symmetric_flip, near_truth, poses_near_truth
from hlp.geometry import rigid

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


@pytest.mark.parametrize(
    ("degrees", "millimetres", "near"),
    [(0, 0, True), (29.9, 0, True), (30.1, 0, False), (0, 29.9, True), (0, 30.1, False)],
)
def test_a_pose_is_near_within_both_bounds_about_the_centroid(degrees, millimetres, near):
    poses = _turned(degrees, millimetres)[None]
    assert poses_near_truth(poses, TRUE, PLAIN, SETTINGS, (30.0, 30.0)).tolist() == [near]


def test_the_turned_pose_of_a_symmetric_object_is_near_only_by_the_policy():
    poses = np.stack([TRUE, TRUE @ BAR_TURN, _turned(90)])
    near = poses_near_truth(poses, TRUE, BAR, SETTINGS, (5.0, 5.0))
    assert near.tolist() == [True, True, False]
    strict = dataclasses.replace(SETTINGS, symmetric=())
    assert poses_near_truth(poses, TRUE, BAR, strict, (5.0, 5.0)).tolist() == [True, False, False]


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
