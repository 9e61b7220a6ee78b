import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.geometry import rotation_distance
from hlp.records import Votes
from hlp.voting.modes import (
    PaperModes,
    PaperVotingSettings,
    SequentialModes,
    SequentialVotingSettings,
)

CENTROID = np.array([0.02, -0.01, 0.03])
HERE, THERE = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.05, 0.9])
EMPTY = Votes(
    np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, int), np.zeros((0, 2))
)


def group(count, center, degrees, seed):
    """Votes within 4 mm and about 2° of a pose."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.normal(size=(count, 3)) * np.deg2rad(1.0))
    rotations = turns.as_matrix() @ Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    return center + rng.uniform(-0.002, 0.002, (count, 3)), rotations


def votes_of(*groups):
    centroids = np.concatenate([centers for centers, _ in groups])
    rotations = np.concatenate([turns for _, turns in groups])
    count = len(centroids)
    return Votes(centroids, rotations, np.ones(count), np.arange(count), np.zeros((count, 2)))


@pytest.fixture
def scattered():
    """40 votes for HERE, 30 of them at 20°; 12 each for four far places, all of them at 120°."""
    table = [group(12, THERE + 0.1 * k, 120.0, 9 + k) for k in range(4)]
    return votes_of(group(30, HERE, 20.0, 0), group(10, HERE, 60.0, 1), *table)


def pose_of(votes, settings):
    pose = SequentialModes(settings).find(votes, CENTROID).poses_cam_obj[0]
    return pose[:3, :3] @ CENTROID + pose[:3, 3], pose[:3, :3]


def brute_force(votes, radius, angle):
    """The definition, from every vote in loops: where most centroids lie, then most rotations."""
    best = max(votes.centroids_cam, key=lambda c: within(votes.centroids_cam, c, radius).sum())
    for _ in range(30):
        best = votes.centroids_cam[within(votes.centroids_cam, best, radius)].mean(axis=0)
    turns = Rotation.from_matrix(votes.rotations_cam_obj[within(votes.centroids_cam, best, radius)])
    near = [(turns * turn.inv()).magnitude() <= angle for turn in turns]
    turn = turns[near[int(np.argmax([each.sum() for each in near]))]].mean()
    for _ in range(30):
        turn = turns[(turns * turn.inv()).magnitude() <= angle].mean()
    return best, turn.as_matrix()


def within(points, center, radius):
    return np.linalg.norm(points - center, axis=1) <= radius


def test_it_is_the_mean_shift_of_the_definition(scattered):
    center, rotation = pose_of(scattered, SequentialVotingSettings(mean_shift_iterations=30))
    expected_center, expected_rotation = brute_force(scattered, 0.010, np.deg2rad(5.0))
    np.testing.assert_allclose(center, expected_center, atol=1e-9)
    assert rotation_distance(rotation, expected_rotation) < 1e-3


def test_rotations_are_those_at_the_translation_found(scattered):
    center, rotation = pose_of(scattered, SequentialVotingSettings())
    truth = Rotation.from_euler("x", 20.0, degrees=True).as_matrix()
    assert np.linalg.norm(center - HERE) < 0.002
    assert rotation_distance(rotation, truth) < np.deg2rad(2.0)
    # Most votes of all are for 120°, so independent modes pair HERE with another place's rotation.
    apart = PaperModes(PaperVotingSettings()).find(scattered, CENTROID).poses_cam_obj[0]
    assert rotation_distance(apart[:3, :3], truth) > np.deg2rad(90.0)


def test_several_poses_are_ordered_by_the_votes_that_agree_with_them(scattered):
    settings = SequentialVotingSettings(hypotheses=4)
    found = SequentialModes(settings).find(scattered, CENTROID)
    np.testing.assert_array_equal(found.support, [30.0, 12.0, 12.0, 12.0])
    centers = found.poses_cam_obj[:, :3, :3] @ CENTROID + found.poses_cam_obj[:, :3, 3]
    np.testing.assert_array_equal(within(centers, HERE, 0.003), [True, False, False, False])
    every = SequentialModes(SequentialVotingSettings(hypotheses=9)).find(scattered, CENTROID)
    np.testing.assert_array_equal(every.support, [30.0, 12.0, 12.0, 12.0, 12.0, 10.0])
    np.testing.assert_array_equal(every.poses_cam_obj[:4], found.poses_cam_obj)


def test_threads_change_nothing_and_no_votes_give_no_pose(scattered):
    settings = SequentialVotingSettings(hypotheses=5)
    one, four = (SequentialModes(settings, n).find(scattered, CENTROID) for n in (1, 4))
    np.testing.assert_array_equal(one.poses_cam_obj, four.poses_cam_obj)
    assert len(SequentialModes(settings).find(EMPTY, CENTROID)) == 0
