"""`poses.csv`, `scores.csv` and the answers of a stream, written and read again."""

import csv
import dataclasses
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from generated_values import motions, texts
from hlp.errors import InputError
from hlp.geometry import rigid
from hlp.records import PoseEstimate, TargetScore
from hlp.results import poses_file
from hlp.results.poses_file import AnswersFile, read_poses, read_scores, write_poses, write_scores

SHIFTS = np.random.default_rng(0).normal(0.5, 0.2, (2, 3))
POSES = rigid(Rotation.random(2, random_state=0).as_matrix(), SHIFTS)
ESTIMATES = [
    PoseEstimate(6, 12, 1, POSES[0], 0.75, {"holistic": 0.1, "refinement": 0.2}),
    PoseEstimate(6, 12, 6, None, 0.0, {"holistic": 0.05}),
    PoseEstimate(6, 18, 6, POSES[1], 0.1),
]


def test_the_file_is_bops(tmp_path):
    path = tmp_path / "poses.csv"
    poses_file.write_poses(path, ESTIMATES)
    header, *rows = list(csv.reader(path.read_text().splitlines()))
    assert header == ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"]
    assert len(rows) == 2 and rows[0][:3] == ["6", "12", "1"]
    numbers = [float(word) for word in rows[0][4].split(" ")]
    np.testing.assert_array_equal(numbers, POSES[0][:3, :3].ravel())
    millimetres = [float(word) for word in rows[0][5].split(" ")]
    np.testing.assert_allclose(millimetres, POSES[0][:3, 3] * 1000)
    assert float(rows[0][6]) == pytest.approx(0.35)
    assert float(rows[1][6]) == -1.0


def test_the_time_is_that_of_all_objects_of_the_image_found_or_not(tmp_path):
    """BOP's `time` is per image: also what was spent on objects that were not found counts."""
    path = tmp_path / "poses.csv"
    estimates = [
        PoseEstimate(6, 1, 1, None, 0.0, {"holistic": 0.5}),
        PoseEstimate(6, 1, 2, POSES[0], 0.9, {"holistic": 0.25, "local": 0.125}),
        PoseEstimate(6, 2, 1, POSES[0], 0.9, {}),  # its time is not known, so the image's is not
        PoseEstimate(6, 2, 2, POSES[0], 0.9, {"holistic": 0.25}),
    ]
    poses_file.write_poses(path, estimates)
    times = [estimate.seconds for estimate in poses_file.read_poses(path)]
    assert times == [{"total": 0.875}, {}, {}]


HEADER = "scene_id,im_id,obj_id,score,R,t,time\n"
TURN, SHIFT = "1 0 0 0 1 0 0 0 1", "0 0 800"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (HEADER + f"6,0,1,0.5,1 0 0 0 1,{SHIFT},1\n", "line 2: no pose"),
        (HEADER + f"6,0,1,0.5,{TURN},{SHIFT},1\n6,0,1,0.5,{TURN}\n", "line 3: it must have 7"),
        (HEADER + f"6,0,1,0.5,{TURN},0 nan 800,1\n", "line 2: NaN"),
        (HEADER + f"6,0,1,0.5,2 0 0 0 1 0 0 0 1,{SHIFT},1\n", "line 2: R is not a rotation"),
        (HEADER + f"6,0,1,0.5,1 0 0 0 1 0 0 0 -1,{SHIFT},1\n", "a reflection"),
        (HEADER + f"6,0,1,0.5,{TURN},{SHIFT},nan\n", "line 2: NaN"),
        (HEADER + f"6,0,1,0.5,{TURN},0 0 1e308,1\n", "or a number beyond"),
        (HEADER + f"6,-1,1,0.5,{TURN},{SHIFT},1\n", "'-1' is not an id"),
        (HEADER + f"6,0,1,0_5,{TURN},{SHIFT},1\n", "'0_5' is no number"),
    ],
)
def test_a_broken_file_is_an_error_that_names_the_line(tmp_path, content, message):
    path = tmp_path / "poses.csv"
    path.write_text(content)
    with pytest.raises(ValueError, match=message) as caught:
        poses_file.read_poses(path)
    assert str(path) in str(caught.value)


SCORE = TargetScore(
    6, 12, 1, True, 0.25, 0.004, 0.1, 0.02, 0.75, True, False, True, 0.5, 0.25, cause="x"
)
WORST = replace(SCORE, found=False, add_error=math.inf, add_correct=False)


def test_scores_are_in_millimetres_and_degrees_with_verdicts_as_numbers(tmp_path):
    path = tmp_path / "scores.csv"
    poses_file.write_scores(path, [SCORE, WORST], {1: "ape"})
    first, last = csv.DictReader(path.read_text().splitlines())
    assert first["object"] == "ape" and float(first["add_mm"]) == pytest.approx(4.0)
    assert float(first["translation_mm"]) == pytest.approx(20.0)
    assert float(first["rotation_deg"]) == pytest.approx(math.degrees(0.1))
    assert (first["add_correct"], first["pose_correct"], first["cause"]) == ("1", "0", "x")
    assert (last["add_mm"], last["add_correct"], last["vsd_recall"]) == ("inf", "0", "nan")


def test_a_broken_score_is_an_error_that_names_the_line(tmp_path):
    path = tmp_path / "scores.csv"
    poses_file.write_scores(path, [SCORE], {1: "ape"})
    path.write_text(path.read_text().replace(",0.25,", ",x,"))
    with pytest.raises(ValueError, match="line 2: no score"):
        poses_file.read_scores(path)


@pytest.mark.parametrize("read", [poses_file.read_poses, poses_file.read_scores])
def test_an_absent_file_and_other_columns_are_named(tmp_path, read):
    path = tmp_path / "results.csv"
    with pytest.raises(FileNotFoundError, match=r"results\.csv"):
        read(path)
    path.write_text("scene_id,im_id\n")
    with pytest.raises(ValueError, match=r"results\.csv: the first line must be"):
        read(path)


ESTIMATE = PoseEstimate(0, 3, 1, POSES[0], 0.75, {"total": 0.125})


def test_every_answer_is_on_disk_at_once(tmp_path):
    with AnswersFile(tmp_path / "out") as file:
        file.add({"im_id": 3, "found": True}, ESTIMATE)
        (line,) = (tmp_path / "out" / "poses.jsonl").read_text().splitlines()
        assert json.loads(line) == {"im_id": 3, "found": True}
        (read,) = read_poses(tmp_path / "out" / "poses.csv")
        np.testing.assert_allclose(read.pose_cam_obj, POSES[0])
        file.add({"im_id": 4, "found": False}, None)
    write_poses(tmp_path / "whole.csv", [ESTIMATE])
    assert (tmp_path / "whole.csv").read_text() == (tmp_path / "out" / "poses.csv").read_text()
    poses = json.loads((tmp_path / "out" / "poses.json").read_text())["poses"]
    assert [pose["im_id"] for pose in poses] == [3, 4]


def test_an_interrupted_call_leaves_the_lines_and_no_old_document(tmp_path):
    with AnswersFile(tmp_path):
        pass
    assert json.loads((tmp_path / "poses.json").read_text()) == {"poses": []}
    with pytest.raises(KeyboardInterrupt), AnswersFile(tmp_path) as file:
        file.add({"im_id": 1}, None)
        raise KeyboardInterrupt
    assert not (tmp_path / "poses.json").exists()
    assert (tmp_path / "poses.jsonl").read_text() == '{"im_id": 1}\n'


def test_two_processes_do_not_write_into_one_folder(tmp_path):
    """Nor two calls in one process; what the first one writes stays whole."""
    with AnswersFile(tmp_path) as file:
        file.add({"im_id": 1}, None)
        with pytest.raises(InputError, match="another process writes into"):
            AnswersFile(tmp_path)
        file.add({"im_id": 2}, None)
    assert (tmp_path / "poses.jsonl").read_text() == '{"im_id": 1}\n{"im_id": 2}\n'
    with AnswersFile(tmp_path):
        pass
    assert {path.name for path in tmp_path.iterdir()} == {"poses.csv", "poses.json", "poses.jsonl"}


IDS = st.integers(0, 10**6)
SECONDS = st.dictionaries(texts(), st.floats(0.0, 1e3), max_size=3)
ANY_ESTIMATES = st.lists(
    st.builds(PoseEstimate, IDS, IDS, IDS, st.none() | motions(5.0), st.floats(0.0, 1.0), SECONDS),
    max_size=5,
)
SIZES = st.floats(0.0, 1e100) | st.just(float("inf"))
SHARES = st.floats(0.0, 1.0) | st.just(float("nan"))
SCORES = st.lists(
    st.builds(
        TargetScore,
        *(IDS, IDS, st.integers(0, 3), st.booleans()),
        *(SHARES, SIZES, SIZES, SIZES, SHARES),
        *(st.booleans(),) * 3,
        *(SHARES,) * 3,
        texts(),
        SHARES,
        st.booleans(),
    ),
    max_size=4,
)


@given(ANY_ESTIMATES)
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
