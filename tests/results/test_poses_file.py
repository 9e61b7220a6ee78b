"""`poses.csv` and `scores.csv` as files; test_results_properties.py reads what was written."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from hlp.records import PoseEstimate, TargetScore
from hlp.results import poses_file


def _pose(seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    return rigid(rotation, np.random.default_rng(seed).normal(0.5, 0.2, 3))


ESTIMATES = [
    PoseEstimate(6, 12, 1, _pose(0), 0.75, {"holistic": 0.1, "refinement": 0.2}),
    PoseEstimate(6, 12, 6, None, 0.0, {"holistic": 0.05}),
    PoseEstimate(6, 18, 6, _pose(1), 0.1),
]


def test_the_file_is_bops(tmp_path):
    path = tmp_path / "poses.csv"
    poses_file.write_poses(path, ESTIMATES)
    header, *rows = list(csv.reader(path.read_text().splitlines()))
    assert header == ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"]
    assert len(rows) == 2 and rows[0][:3] == ["6", "12", "1"]
    numbers = [float(word) for word in rows[0][4].split(" ")]
    np.testing.assert_array_equal(numbers, _pose(0)[:3, :3].ravel())
    millimetres = [float(word) for word in rows[0][5].split(" ")]
    np.testing.assert_allclose(millimetres, _pose(0)[:3, 3] * 1000)
    assert float(rows[0][6]) == pytest.approx(0.35)
    assert float(rows[1][6]) == -1.0


def test_the_time_is_that_of_all_objects_of_the_image_found_or_not(tmp_path):
    """BOP's `time` is per image: also what was spent on objects that were not found counts."""
    path = tmp_path / "poses.csv"
    estimates = [
        PoseEstimate(6, 1, 1, None, 0.0, {"holistic": 0.5}),
        PoseEstimate(6, 1, 2, _pose(0), 0.9, {"holistic": 0.25, "local": 0.125}),
        PoseEstimate(6, 2, 1, _pose(0), 0.9, {}),  # its time is not known, so the image's is not
        PoseEstimate(6, 2, 2, _pose(0), 0.9, {"holistic": 0.25}),
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
        (HEADER + f"6,0,1,0.5,{TURN},{SHIFT},1\n6,0,1,0.5,{TURN}\n", "line 3: no pose"),
        (HEADER + f"6,0,1,0.5,{TURN},0 nan 800,1\n", "line 2: NaN"),
        (HEADER + f"6,0,1,0.5,2 0 0 0 1 0 0 0 1,{SHIFT},1\n", "line 2: R is not a rotation"),
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
