"""Results of runs, written and read again, whatever the numbers and names."""

import dataclasses
import json
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from generated_values import motions, texts
from hlp.files import read_json
from hlp.records import PoseEstimate, TargetScore
from hlp.results.poses_file import AnswersFile, read_poses, read_scores, write_poses, write_scores

IDS = st.integers(0, 10**6)
SECONDS = st.dictionaries(texts(), st.floats(0.0, 1e3), max_size=3)
ESTIMATES = st.lists(
    st.builds(
        PoseEstimate,
        IDS,
        IDS,
        IDS,
        st.none() | motions(5.0),
        st.floats(0.0, 1.0),
        SECONDS,
    ),
    max_size=5,
)
NUMBERS = st.floats(-1e100, 1e100) | st.sampled_from([float("nan"), float("inf")])
SCORES = st.lists(
    st.builds(
        TargetScore,
        *(IDS, IDS, st.integers(0, 3), st.booleans()),
        *(NUMBERS,) * 5,
        *(st.booleans(),) * 3,
        *(NUMBERS,) * 3,
        texts(),
        NUMBERS,
        st.booleans(),
    ),
    max_size=4,
)


@given(ESTIMATES)
def test_poses_come_back(tmp_path: Path, estimates):
    write_poses(tmp_path / "poses.csv", estimates)
    sent = [estimate for estimate in estimates if estimate.pose_cam_obj is not None]
    back = read_poses(tmp_path / "poses.csv")
    assert len(back) == len(sent)
    for ours, theirs in zip(back, sent, strict=True):
        for field in ("scene_id", "frame_id", "object_id", "score"):
            assert getattr(ours, field) == getattr(theirs, field)
        np.testing.assert_array_equal(ours.pose_cam_obj[:3, :3], theirs.pose_cam_obj[:3, :3])
        np.testing.assert_allclose(
            ours.pose_cam_obj[:3, 3], theirs.pose_cam_obj[:3, 3], rtol=1e-15, atol=1e-300
        )
    write_poses(tmp_path / "again.csv", back)
    again = read_poses(tmp_path / "again.csv")
    for first, second in zip(back, again, strict=True):
        np.testing.assert_allclose(first.pose_cam_obj, second.pose_cam_obj, rtol=1e-15)


@given(ESTIMATES)
def test_answers_of_a_stream_come_back_as_csv_and_json(tmp_path: Path, estimates):
    posed = [estimate for estimate in estimates if estimate.pose_cam_obj is not None]
    with AnswersFile(tmp_path) as answers:
        for estimate in posed:
            answers.add(
                {"score": estimate.score, "t": estimate.pose_cam_obj[:3, 3].tolist()}, estimate
            )
    assert len(read_poses(tmp_path / "poses.csv")) == len(posed)
    lines = [json.loads(line) for line in (tmp_path / "poses.jsonl").read_text().splitlines()]
    assert read_json(tmp_path / "poses.json")["poses"] == lines
    assert [line["score"] for line in lines] == [estimate.score for estimate in posed]


@given(SCORES, st.lists(texts(), min_size=4, max_size=4))
def test_scores_come_back(tmp_path: Path, scores, names):
    write_scores(tmp_path / "scores.csv", scores, dict(enumerate(names)))
    back, back_names = read_scores(tmp_path / "scores.csv")
    assert back_names == {score.object_id: names[score.object_id] for score in scores}
    assert len(back) == len(scores)
    for ours, theirs in zip(back, scores, strict=True):
        for field in dataclasses.fields(TargetScore):
            one, other = getattr(ours, field.name), getattr(theirs, field.name)
            if isinstance(other, float):
                np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-300)
            else:
                assert one == other, field.name
