import dataclasses

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from waterfall_bounds import BOUNDS

from hlp.evaluation.errors import is_symmetric_flip, near_truth, poses_near_truth
from hlp.evaluation.settings import EvaluationSettings
from hlp.geometry import rigid
from hlp.records import Mesh, ObjectModel

SETTINGS = EvaluationSettings("test", ["bar"], 0.1, 5.0, 5.0, 0.5, 100, BOUNDS)
HALF_TURN = rigid(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
TRUE = rigid(Rotation.from_rotvec([0.4, 0.2, 0.1]).as_matrix(), np.array([0.05, 0.0, 0.8]))


def _model(name, symmetries=None):
    """A bar whose bounding box is centred 0.2 m beside the object's origin."""
    box = trimesh.creation.box((0.02, 0.04, 0.12)).subdivide().subdivide()
    vertices = np.array(box.vertices) + np.array([0.2, 0.0, 0.0])
    colors = np.zeros((len(vertices), 3), np.uint8)
    mesh = Mesh(vertices, np.array(box.faces), colors, np.array(box.vertex_normals))
    diameter = float(np.linalg.norm([0.02, 0.04, 0.12]))
    symmetries = np.eye(4)[None] if symmetries is None else symmetries
    return ObjectModel(1, name, mesh, mesh, diameter, symmetries, 0.08, 0.03)


PLAIN = _model("box")
SHIFT = rigid(np.eye(3), np.array([0.2, 0.0, 0.0]))
BAR_TURN = SHIFT @ HALF_TURN @ rigid(np.eye(3), np.array([-0.2, 0.0, 0.0]))
BAR = _model("bar", np.stack([np.eye(4), BAR_TURN]))


def _turned(degrees, millimetres=0.0, axis=(0.0, 1.0, 0.0)):
    """The true pose turned about the object's centroid, then moved."""
    turn = rigid(
        Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis)).as_matrix(), np.zeros(3)
    )
    pose = TRUE @ SHIFT @ turn @ rigid(np.eye(3), np.array([-0.2, 0.0, 0.0]))
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
    strict = dataclasses.replace(SETTINGS, symmetric=[])
    assert poses_near_truth(poses, TRUE, BAR, strict, (5.0, 5.0)).tolist() == [True, False, False]


def test_votes_near_the_truth_are_those_that_angles_and_distances_say():
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


def test_no_vote_is_near_nothing():
    none = near_truth(np.zeros((0, 3, 3)), np.zeros((0, 3)), TRUE, BAR, SETTINGS, (15.0, 20.0))
    assert none.shape == (0,)


def test_flipped_is_what_lies_on_the_surface_but_is_turned():
    about_z = (0.0, 0.0, 1.0)
    assert is_symmetric_flip(_turned(180, axis=about_z), TRUE, PLAIN, SETTINGS)
    assert not is_symmetric_flip(_turned(90), TRUE, PLAIN, SETTINGS)  # the bar lies across
    assert not is_symmetric_flip(
        _turned(20, axis=about_z), TRUE, PLAIN, SETTINGS
    )  # within the basin
    assert not is_symmetric_flip(_turned(180, 40, axis=about_z), TRUE, PLAIN, SETTINGS)  # elsewhere
    assert not is_symmetric_flip(
        _turned(180, axis=about_z), TRUE, BAR, SETTINGS
    )  # that one is right
