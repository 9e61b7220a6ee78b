import dataclasses
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.geometry import quaternions, rotation_distance
from hlp.patches.sampling import join
from hlp.records import Votes
from hlp.voting.modes import (
    JointVotingSettings,
    MeanShiftModes,
    PaperVotingSettings,
    SequentialVotingSettings,
)

PAPER = PaperVotingSettings("paper", 3.0, False, False, 10.0, 5.0, 3000, 30)
JOINT = JointVotingSettings("joint", 3.0, True, True, 20.0, 18.0, 1500, 5, 5)
CENTROID = np.array([0.02, -0.01, 0.03])
RADIUS, ANGLE = 0.02, np.deg2rad(18.0)
HERE, THERE = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.05, 0.9])


def make_votes(*groups, seed=0):
    """Votes of groups (count, centre, rotation, spread (m), spread (degrees), weight)."""
    rng = np.random.default_rng(seed)
    centroids, rotations, weights = [], [], []
    for count, center, rotation, metres, degrees, weight in groups:
        centroids.append(center + rng.normal(size=(count, 3)) * metres / np.sqrt(3))
        axes = rng.normal(size=(count, 3)) * np.deg2rad(degrees) / np.sqrt(3)
        turns = Rotation.from_rotvec(axes).as_matrix()
        rotations.append(turns @ rotation)
        weights.append(np.full(count, weight))
    count = sum(len(part) for part in weights)
    parts = (np.concatenate(part) for part in (centroids, rotations, weights))
    return Votes(*parts, np.arange(count), np.zeros((count, 2)))


def clutter(count, seed=9):
    rng = np.random.default_rng(seed)
    return Votes(
        HERE + rng.uniform(-0.3, 0.3, (count, 3)),
        Rotation.random(count, random_state=seed).as_matrix(),
        np.ones(count), np.arange(count), np.zeros((count, 2)),
    )  # fmt: skip


def rotation(degrees, axis="x"):
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def voted_center(pose):
    return pose[:3, :3] @ CENTROID + pose[:3, 3]


def brute_mode(values, weights, radius, distance, mean):
    """Flat-kernel mean shift from every vote, in loops; the centre with the most weight."""
    best, most = None, -1.0
    for center in values:
        for _ in range(10):
            inside = distance(values, center) <= radius
            center = mean(values[inside], weights[inside])
        weight = weights[distance(values, center) <= radius].sum()
        if weight > most + 1e-9:
            best, most = center, weight
    return best


def brute_translation(votes):
    return brute_mode(
        votes.centroids_cam,
        votes.weights,
        0.010,
        lambda a, b: np.linalg.norm(a - b, axis=1),
        lambda a, weights: np.average(a, axis=0, weights=weights),
    )


def brute_rotation(votes):
    """With SciPy's mean of rotations, which knows no signs."""
    return brute_mode(
        votes.rotations_cam_obj,
        votes.weights,
        np.deg2rad(5.0),
        rotation_distance,
        lambda a, weights: Rotation.from_matrix(a).mean(weights=weights).as_matrix(),
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_the_papers_modes_equal_brute_force(seed):
    groups = (
        (40, HERE, rotation(30), 0.004, 2.0, 1.0),
        (25, THERE, rotation(120, "y"), 0.004, 2.0, 1.0),
    )
    votes = join([make_votes(*groups, seed=seed), clutter(40, seed)])
    found = MeanShiftModes(PAPER).find(votes, CENTROID)
    assert len(found) == 1
    pose = found.poses_cam_obj[0]
    expected = brute_translation(votes)
    np.testing.assert_allclose(voted_center(pose), expected, atol=1e-9)
    turned = brute_rotation(votes)
    assert np.rad2deg(rotation_distance(pose[:3, :3], turned)) < 0.02
    assert np.linalg.norm(expected - HERE) < 0.003  # the larger group
    near = np.linalg.norm(votes.centroids_cam - HERE, axis=1) < 0.02
    assert 20 <= found.support[0] <= near.sum()


@pytest.mark.parametrize("finder", [MeanShiftModes(PAPER), MeanShiftModes(JOINT)])
@pytest.mark.parametrize("quat", [(1, -1, 0, 0), (0, 1, -1, 0), (-1, 0, 0, 1)])
def test_q_and_minus_q_are_one_rotation(finder, quat):
    # Two components of the quaternion are equally large and of opposite sign, and SciPy makes the
    # largest one positive: nearby rotations come with both signs.
    turn = Rotation.from_quat(quat).as_matrix()
    votes = make_votes((60, HERE, turn, 0.003, 2.5, 1.0))
    quats = quaternions(votes.rotations_cam_obj)
    assert 10 < (quats @ quats[0] > 0).sum() < 50
    found = finder.find(votes, CENTROID)
    assert np.rad2deg(rotation_distance(found.poses_cam_obj[0, :3, :3], turn)) < 1.0
    assert found.support[0] > 0.7 * 60


def two_objects():
    """Most votes lie HERE, but of any rotation; most of one rotation lie THERE."""
    first = 20, HERE, rotation(20), 0.003, 1.0, 1.0
    second = 25, THERE, rotation(100, "y"), 0.003, 1.0, 1.0
    turned = dataclasses.replace(clutter(15), centroids_cam=np.tile(HERE, (15, 1)))
    return join([make_votes(first, second), turned])


def test_joint_modes_pair_no_translation_with_the_rotation_of_another_hypothesis():
    """The paper's may."""
    found = MeanShiftModes(JOINT).find(two_objects(), CENTROID)
    for pose, place, turn in zip(
        found.poses_cam_obj[:2], (THERE, HERE), (rotation(100, "y"), rotation(20)), strict=True
    ):
        np.testing.assert_allclose(voted_center(pose), place, atol=0.003)
        assert np.rad2deg(rotation_distance(pose[:3, :3], turn)) < 1.0
    np.testing.assert_allclose(found.support[:2], [25, 20])
    (pose,) = MeanShiftModes(PAPER).find(two_objects(), CENTROID).poses_cam_obj
    np.testing.assert_allclose(voted_center(pose), HERE, atol=0.003)
    assert np.rad2deg(rotation_distance(pose[:3, :3], rotation(100, "y"))) < 1.0


def many_objects(seed=3):
    groups = [
        (30 - 3 * i, HERE + np.array([0.06 * (i % 4), 0.06 * (i // 4), 0.0]), rotation(70 * i, "z"),
         0.006, 4.0, 1.0 - 0.02 * i)
        for i in range(8)
    ]  # fmt: skip
    return join([make_votes(*groups, seed=seed), clutter(60, seed)])


def inside(votes, pose):
    apart = np.linalg.norm(votes.centroids_cam - voted_center(pose), axis=1)
    turned = rotation_distance(votes.rotations_cam_obj, pose[:3, :3])
    return (apart <= RADIUS) & (turned <= ANGLE)


@pytest.mark.parametrize("hypotheses", [1, 5])
def test_joint_modes_are_means_ranked_distinct_and_no_more_than_asked_for(hypotheses):
    votes = many_objects()
    settings = dataclasses.replace(JOINT, hypotheses=hypotheses, mean_shift_iterations=30)
    found, by_two = (MeanShiftModes(settings, threads).find(votes, CENTROID) for threads in (1, 2))
    np.testing.assert_array_equal(found.poses_cam_obj, by_two.poses_cam_obj)
    np.testing.assert_array_equal(found.support, by_two.support)
    assert len(found) == hypotheses
    assert (np.diff(found.support) <= 0).all()
    for pose, support in zip(found.poses_cam_obj, found.support, strict=True):
        near = inside(votes, pose)
        assert support == pytest.approx(votes.weights[near].sum())
        mean = np.average(votes.centroids_cam[near], axis=0, weights=votes.weights[near])
        np.testing.assert_allclose(voted_center(pose), mean, atol=1e-9)
        turn = Rotation.from_matrix(votes.rotations_cam_obj[near]).mean(votes.weights[near])
        assert np.rad2deg(rotation_distance(pose[:3, :3], turn.as_matrix())) < 0.02
    for one, other in combinations(found.poses_cam_obj, 2):
        apart = np.linalg.norm(voted_center(one) - voted_center(other))
        assert apart > RADIUS or rotation_distance(one[:3, :3], other[:3, :3]) > ANGLE


@pytest.mark.parametrize("settings", [PAPER, JOINT])
def test_only_the_strongest_votes_count_where_there_are_too_many(settings):
    weak = make_votes((50, HERE, rotation(20), 0.003, 1.0, 0.1))
    strong = make_votes((4, THERE, rotation(90), 0.003, 1.0, 0.9))
    votes = join([weak, strong])
    every = MeanShiftModes(settings).find(votes, CENTROID)
    few = MeanShiftModes(dataclasses.replace(settings, max_votes=10)).find(votes, CENTROID)
    np.testing.assert_allclose(voted_center(every.poses_cam_obj[0]), HERE, atol=0.004)
    np.testing.assert_allclose(voted_center(few.poses_cam_obj[0]), THERE, atol=0.004)


@pytest.mark.parametrize("settings", [PAPER, JOINT, SequentialVotingSettings(hypotheses=5)])
def test_few_votes(settings):
    finder = MeanShiftModes(settings)
    none = make_votes((0, HERE, np.eye(3), 0.0, 0.0, 1.0))
    found = finder.find(none, CENTROID)
    assert len(found) == 0 and found.poses_cam_obj.shape == (0, 4, 4)
    one = make_votes((1, HERE, rotation(40), 0.0, 0.0, 0.7))
    found = finder.find(one, CENTROID)
    assert len(found) == 1 and found.support[0] == pytest.approx(0.7)
    np.testing.assert_allclose(voted_center(found.poses_cam_obj[0]), HERE, atol=1e-12)
    np.testing.assert_allclose(found.poses_cam_obj[0, :3, :3], rotation(40), atol=1e-9)


def test_modes_are_ranked_by_the_votes_of_the_mode_not_of_the_seed():
    # Around a hollow ball no vote sees all the others, but their mean does.
    directions = np.random.default_rng(0).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ball = make_votes((20, THERE, rotation(50), 0.0, 1.0, 1.0))
    ball = dataclasses.replace(ball, centroids_cam=THERE + 0.65 * RADIUS * directions)
    apart = np.linalg.norm(ball.centroids_cam[:, None] - ball.centroids_cam, axis=2)
    assert (apart <= RADIUS).sum(axis=1).max() < 16
    votes = join([make_votes((16, HERE, rotation(20), 0.001, 1.0, 1.0)), ball])
    found = MeanShiftModes(JOINT).find(votes, CENTROID)
    np.testing.assert_allclose(voted_center(found.poses_cam_obj[0]), THERE, atol=0.006)
    np.testing.assert_array_equal(found.support[:2], [20.0, 16.0])


def test_without_shifts_the_support_of_a_mode_is_that_of_its_vote():
    """The compiled count of agreeing votes against SciPy's distances and angles, vote by vote."""
    groups = [(60, HERE + 0.03 * i, rotation(25 * i), 0.02, 15.0, 1.0) for i in range(4)]
    votes = join([make_votes(*groups), clutter(50)])
    rng = np.random.default_rng(1)
    votes = dataclasses.replace(votes, weights=rng.uniform(0.1, 1.0, len(votes)))
    angles = rotation_distance(votes.rotations_cam_obj[:, None], votes.rotations_cam_obj[None])
    apart = np.linalg.norm(votes.centroids_cam[:, None] - votes.centroids_cam, axis=2)
    agree = (apart <= RADIUS) & (angles <= ANGLE)
    support = agree @ votes.weights
    expected, free = [], np.ones(len(votes), dtype=bool)
    while free.any() and len(expected) < 5:
        best = int(np.argmax(np.where(free, support, -1.0)))
        expected.append(best)
        free &= ~agree[best]
    found = MeanShiftModes(dataclasses.replace(JOINT, mean_shift_iterations=0)).find(
        votes, CENTROID
    )
    np.testing.assert_allclose(found.support, support[expected], rtol=1e-12)
    for pose, vote in zip(found.poses_cam_obj, expected, strict=True):
        np.testing.assert_allclose(voted_center(pose), votes.centroids_cam[vote], atol=1e-12)
        np.testing.assert_allclose(pose[:3, :3], votes.rotations_cam_obj[vote], atol=1e-9)


@pytest.fixture
def scattered():
    """40 votes for HERE, 30 of them at 20°; 12 each for four far places, all of them at 120°."""
    table = [(12, THERE + 0.1 * k, rotation(120), 0.002, 1.7, 1.0) for k in range(4)]
    here = [
        (count, HERE, rotation(degrees), 0.002, 1.7, 1.0) for count, degrees in ((30, 20), (10, 60))
    ]
    return make_votes(*here, *table)


def test_rotations_are_sought_among_the_votes_near_the_translation(scattered):
    """Both by the definition of the mean shift."""
    settings = SequentialVotingSettings(mean_shift_iterations=30)
    pose = MeanShiftModes(settings).find(scattered, CENTROID).poses_cam_obj[0]
    expected = brute_translation(scattered)
    np.testing.assert_allclose(voted_center(pose), expected, atol=1e-9)
    near = np.linalg.norm(scattered.centroids_cam - expected, axis=1) <= 0.010
    there = Votes(*(values[near] for values in vars(scattered).values()))
    turn = brute_rotation(there)
    assert rotation_distance(pose[:3, :3], turn) < 1e-3


def test_several_poses_are_ordered_by_the_votes_that_agree_with_them(scattered):
    found, every = (
        MeanShiftModes(SequentialVotingSettings(hypotheses=most)).find(scattered, CENTROID)
        for most in (4, 9)
    )
    np.testing.assert_array_equal(found.support, [30.0, 12.0, 12.0, 12.0])
    off = [np.linalg.norm(voted_center(pose) - HERE) for pose in found.poses_cam_obj]
    assert off[0] < 0.003 < min(off[1:])
    np.testing.assert_array_equal(every.support, [30.0, 12.0, 12.0, 12.0, 12.0, 10.0])
    np.testing.assert_array_equal(every.poses_cam_obj[:4], found.poses_cam_obj)
