import csv

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from hlp.records import PoseEstimate
from hlp.results import poses_file


def _pose(seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    return rigid(rotation, np.random.default_rng(seed).normal(0.5, 0.2, 3))


ESTIMATES = [
    PoseEstimate(6, 12, 1, _pose(0), 0.75, {"holistic": 0.1, "refinement": 0.2}),
    PoseEstimate(6, 12, 6, None, 0.0, {"holistic": 0.05}),
    PoseEstimate(6, 18, 6, _pose(1), 0.1),
]


def test_poses_come_back_as_they_were(tmp_path):
    path = tmp_path / "run" / "poses.csv"
    poses_file.write_poses(path, ESTIMATES)
    first, last = poses_file.read_poses(path)
    for back, sent in ((first, ESTIMATES[0]), (last, ESTIMATES[2])):
        assert (back.scene_id, back.frame_id, back.object_id) == (
            sent.scene_id,
            sent.frame_id,
            sent.object_id,
        )
        assert back.score == sent.score
        np.testing.assert_array_equal(back.pose_cam_obj[:3, :3], sent.pose_cam_obj[:3, :3])
        np.testing.assert_allclose(back.pose_cam_obj, sent.pose_cam_obj, rtol=1e-15)
    assert first.seconds == {"total": pytest.approx(0.35)}
    assert last.seconds == {}


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
    poses_file.write_poses(
        path,
        [
            PoseEstimate(6, 1, 1, None, 0.0, {"holistic": 0.5}),
            PoseEstimate(6, 1, 2, _pose(0), 0.9, {"holistic": 0.25, "local": 0.125}),
            PoseEstimate(
                6, 2, 1, _pose(0), 0.9, {}
            ),  # its time is not known, so the image's is not
            PoseEstimate(6, 2, 2, _pose(0), 0.9, {"holistic": 0.25}),
        ],
    )
    times = [each.seconds for each in poses_file.read_poses(path)]
    assert times == [{"total": 0.875}, {}, {}]


HEADER = "scene_id,im_id,obj_id,score,R,t,time\n"
TURN, SHIFT = "1 0 0 0 1 0 0 0 1", "0 0 800"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("scene,im\n", "first line"),
        (HEADER + f"6,0,1,0.5,1 0 0 0 1,{SHIFT},1\n", "line 2: no pose"),
        (HEADER + f"6,0,1,0.5,{TURN},{SHIFT},1\n6,0,1,0.5,{TURN}\n", "line 3: no pose"),
        (HEADER + f"6,0,1,0.5,{TURN},0 nan 800,1\n", "line 2: NaN"),
        (HEADER + f"6,0,1,0.5,2 0 0 0 1 0 0 0 1,{SHIFT},1\n", "line 2: R is no rotation"),
    ],
)
def test_a_broken_file_is_an_error_that_names_the_line(tmp_path, content, message):
    path = tmp_path / "poses.csv"
    path.write_text(content)
    with pytest.raises(ValueError, match=message) as caught:
        poses_file.read_poses(path)
    assert str(path) in str(caught.value)


def test_an_absent_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"poses\.csv"):
        poses_file.read_poses(tmp_path / "poses.csv")
