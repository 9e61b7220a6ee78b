"""What is written of a frame comes back as it was."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fake_detection import OBJECTS, SHAPE, CountedFrames, FakeEstimator
from hlp.method.find.estimator import CoarseResult
from hlp.records import Hypotheses, Votes
from hlp.refinement.pose_fit import PoseFit
from hlp.stages.frame_files import read_arrays, write_arrays
from hlp.stages.frame_results import (
    coarse_arrays,
    hypotheses_of,
    read_regions,
    refined_arrays,
    region_arrays,
    regions_of,
    votes_of,
)

FRAME = CountedFrames().load("000000_000001")


@pytest.fixture
def context():
    return FakeEstimator().prepare(FRAME)


def test_regions_come_back_whole(context, tmp_path):
    regions = {i: FakeEstimator().find_region(context, i) for i in OBJECTS}
    arrays = region_arrays(regions[3]) | region_arrays(regions[7])
    assert arrays["3/mask"].size == -(-SHAPE[0] * SHAPE[1] // 8)  # a bit a pixel
    write_arrays(tmp_path, FRAME.key, arrays)
    for found in (regions_of(arrays, SHAPE), read_regions(tmp_path, FRAME)):
        assert found.keys() == {*OBJECTS}
        for object_id, region in regions.items():
            np.testing.assert_array_equal(found[object_id].mask, region.mask)
            np.testing.assert_array_equal(found[object_id].centers, region.centers)
            np.testing.assert_allclose(found[object_id].probabilities, region.probabilities)


def test_hypotheses_come_back_exactly_and_votes_to_a_micrometre(context, tmp_path):
    rng = np.random.default_rng(0)
    turns = Rotation.random(30, rng=0).as_matrix()
    centroids = rng.uniform(-2.0, 2.0, (30, 3))
    pixels = rng.integers(0, 4000, (30, 2)).astype(np.float64)
    votes = Votes(centroids, turns, rng.random(30), np.arange(30), pixels)
    poses = np.tile(np.eye(4), (2, 1, 1)) * rng.random((2, 1, 1))
    patches = (
        FakeEstimator().find_hypotheses(context, FakeEstimator().find_region(context, 3)).patches
    )
    coarse = CoarseResult(patches, votes, Hypotheses(poses, rng.random(2)), 0.1, 0.1)
    write_arrays(tmp_path, FRAME.key, coarse_arrays(3, coarse))
    stored = read_arrays(tmp_path, FRAME.key)
    np.testing.assert_array_equal(hypotheses_of(stored, 3).poses_cam_obj, poses)
    np.testing.assert_array_equal(hypotheses_of(stored, 3).support, coarse.hypotheses.support)
    found = votes_of(stored, 3)
    np.testing.assert_allclose(found.centroids_cam, centroids, atol=1e-6)
    np.testing.assert_allclose(found.rotations_cam_obj, turns, atol=1e-6)
    np.testing.assert_allclose(found.weights, votes.weights, atol=1e-6)
    np.testing.assert_array_equal(found.pixels, pixels)


def test_votes_of_one_patch_keep_belonging_together(context):
    """Patches are numbered anew, since those that cast no vote are not stored."""
    patches = np.array([4, 4, 2, 9, 2])
    pixels = np.array([[8.0, 16.0], [0.0, 40.0], [8.0, 8.0]])[[0, 0, 1, 2, 1]]
    votes = Votes(np.zeros((5, 3)), np.stack([np.eye(3)] * 5), np.ones(5), patches, pixels)
    coarse = FakeEstimator().find_hypotheses(context, FakeEstimator().find_region(context, 3))
    found = votes_of(coarse_arrays(3, dataclasses.replace(coarse, votes=votes)), 3)
    same = found.patches[:, None] == found.patches
    np.testing.assert_array_equal(same, patches[:, None] == patches)


def test_an_object_without_hypotheses_is_still_known_to_have_been_looked_for(context):
    assert refined_arrays(7, None, []).keys() == {"7/looked_for"}
    refined = FakeEstimator().refine(context, 3, Hypotheses(np.stack([np.eye(4)] * 2), np.ones(2)))
    fit = PoseFit(0.2, 0.9, 0.8, 3.0, 1.0)
    arrays = refined_arrays(3, refined, [fit])
    assert PoseFit.from_array(arrays["3/fits"][0]) == fit
    np.testing.assert_array_equal(arrays["3/poses"][:, 0, 3], [1.0, 2.0])
    np.testing.assert_array_equal(arrays["3/sources"], [1, 0])
    assert arrays["3/instances"] == [1] and arrays["3/looked_for"]
