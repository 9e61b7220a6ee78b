"""What is written of a frame comes back as it was, whole or not at all."""

import itertools
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from damage import damage, flipped
from fake_detection import OBJECTS, SHAPE, CountedFrames, FakeEstimator
from hlp.errors import DataError
from hlp.method.find.search import search_frame
from hlp.method.find.trace import STAGES, ObjectTrace
from hlp.records import Hypotheses, Votes
from hlp.stages.trace_files import (
    has_arrays,
    read_arrays,
    read_trace,
    write_arrays,
    write_failure,
    write_trace,
)

FRAME = CountedFrames().load("000000_000001")
ARRAYS = {"6/poses": np.arange(32.0).reshape(2, 4, 4), "6/mask": np.arange(9, dtype=np.uint8)}


@pytest.fixture
def trace():
    estimator = FakeEstimator()
    counts = dict.fromkeys(OBJECTS, 1)
    return search_frame(estimator.prepare(FRAME), counts, by_threads=False)


def written(folder, trace, stages=STAGES):
    folders = {stage: folder / stage for stage in stages}
    for stage, own in folders.items():
        own.mkdir()
        write_trace(own, FRAME.key, stage, trace)
    found = read_trace(folders, FRAME.key)
    assert not isinstance(found, str)
    return found


def test_regions_and_refined_poses_come_back_exactly(trace, tmp_path):
    found = written(tmp_path, trace)
    assert [*found] == [*trace]
    for object_id, before in trace.items():
        region, refined, after = before.region, before.refined, found[object_id]
        assert region and refined and after.region and after.refined
        for name in ("centers", "probabilities", "mask"):
            np.testing.assert_array_equal(getattr(after.region, name), getattr(region, name))
        for name in ("costs", "sources", "starts"):
            np.testing.assert_array_equal(getattr(after.refined, name), getattr(refined, name))
        np.testing.assert_array_equal(after.refined.chosen_poses, refined.chosen_poses)
        assert after.fits == before.fits and after.refined.instances == refined.instances
    bits = np.load(tmp_path / "regions" / f"{FRAME.key}.npz")[f"{OBJECTS[0]}/mask"].size
    assert bits == -(-SHAPE[0] * SHAPE[1] // 8)  # a bit a pixel


def test_hypotheses_come_back_exactly_and_votes_to_a_micrometre(tmp_path):
    rng = np.random.default_rng(0)
    turns = Rotation.random(30, random_state=0).as_matrix()
    centroids = rng.uniform(-2.0, 2.0, (30, 3))
    pixels = rng.integers(0, 4000, (30, 2)).astype(np.float64)
    votes = Votes(centroids, turns, rng.random(30), np.arange(30), pixels)
    poses = np.tile(np.eye(4), (2, 1, 1)) * rng.random((2, 1, 1))
    before = ObjectTrace(votes=votes, hypotheses=Hypotheses(poses, rng.random(2)))
    found = written(tmp_path, {3: before}, ("hypotheses",))[3]
    assert found.hypotheses and found.votes and before.hypotheses
    np.testing.assert_array_equal(found.hypotheses.poses_cam_obj, poses)
    np.testing.assert_array_equal(found.hypotheses.support, before.hypotheses.support)
    np.testing.assert_allclose(found.votes.centroids_cam, centroids, atol=1e-6)
    np.testing.assert_allclose(found.votes.rotations_cam_obj, turns, atol=1e-6)
    np.testing.assert_allclose(found.votes.weights, votes.weights, atol=1e-6)
    np.testing.assert_array_equal(found.votes.pixels, pixels)


def test_votes_of_one_patch_keep_belonging_together(trace, tmp_path):
    """Patches are numbered anew, since those that cast no vote are not stored."""
    patches = np.array([4, 4, 2, 9, 2])
    pixels = np.array([[8.0, 16.0], [0.0, 40.0], [8.0, 8.0]])[[0, 0, 1, 2, 1]]
    votes = Votes(np.zeros((5, 3)), np.stack([np.eye(3)] * 5), np.ones(5), patches, pixels)
    found = written(tmp_path, {3: replace(trace[3], votes=votes)}, ("hypotheses",))[3].votes
    assert found is not None
    same = found.patches[:, None] == found.patches
    np.testing.assert_array_equal(same, patches[:, None] == patches)


def test_an_object_without_an_answer_is_known_to_have_been_looked_for(tmp_path):
    assert written(tmp_path, {7: ObjectTrace()}, ("poses",)) == {7: ObjectTrace()}


def test_a_failure_stands_in_place_of_a_trace(tmp_path):
    write_failure(tmp_path, "key", "the depth is gone")
    assert read_trace({"regions": tmp_path}, "key") == "the depth is gone"


def test_a_frame_without_anything_is_a_file_too(tmp_path):
    write_trace(tmp_path, "key", "poses", {})
    assert read_trace({"poses": tmp_path}, "key") == {} and has_arrays(tmp_path, "key")


def test_no_flipped_bit_changes_what_is_read(tmp_path):
    write_arrays(tmp_path, "key", ARRAYS)
    path = tmp_path / "key.npz"
    whole = path.read_bytes()
    for at in range(len(whole)):
        path.write_bytes(flipped(whole, at))
        if has_arrays(tmp_path, "key"):  # a time, or another thing that nothing depends on
            found = read_arrays(tmp_path, "key")
            assert found.keys() == ARRAYS.keys()
            assert all(np.array_equal(found[name], ARRAYS[name]) for name in ARRAYS)


def test_a_file_of_another_frame_or_output_is_noticed(tmp_path):
    one, other = tmp_path / "poses" / "00.partial", tmp_path / "poses" / "11.partial"
    for folder, key in itertools.product((one, other), "ab"):
        write_arrays(folder, key, ARRAYS)
    (other / "a.npz").replace(one / "b.npz")
    with (tmp_path / "bare.npz").open("wb") as stream:
        np.savez(stream, **ARRAYS)
    for odd in (one / "a.npz", other / "b.npz", tmp_path / "bare.npz"):
        shutil.copy(odd, one / "b.npz")
        assert has_arrays(one, "a") and not has_arrays(one, "b")
        with pytest.raises(DataError, match=r"b\.npz is of another frame"):
            read_arrays(one, "b")
    one.rename(one.with_suffix(""))  # when all is made
    assert read_arrays(one.with_suffix(""), "a").keys() == ARRAYS.keys()


@pytest.mark.parametrize("how", ["empty", "cut", "end lost"])
def test_a_damaged_file_is_named_and_a_missing_one_is_no_damage(tmp_path, how):
    write_arrays(tmp_path, "key", ARRAYS)
    assert has_arrays(tmp_path, "key")
    damage([tmp_path / "key.npz"], how)
    assert not has_arrays(tmp_path, "key")
    with pytest.raises(DataError, match=r"key\.npz is damaged.*delete its folder"):
        read_arrays(tmp_path, "key")
    with pytest.raises(FileNotFoundError, match=r"other\.npz"):
        read_arrays(tmp_path, "other")
