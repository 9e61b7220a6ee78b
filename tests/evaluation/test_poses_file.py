import csv
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.evaluation import poses_file
from hlp.geometry import rigid
from hlp.records import PoseEstimate, TargetScore


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
    header, *rows = list(csv.reader(path.open()))
    assert header == ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"]
    assert len(rows) == 2 and rows[0][:3] == ["6", "12", "1"]
    numbers = [float(word) for word in rows[0][4].split(" ")]
    np.testing.assert_array_equal(numbers, _pose(0)[:3, :3].ravel())
    millimetres = [float(word) for word in rows[0][5].split(" ")]
    np.testing.assert_allclose(millimetres, _pose(0)[:3, 3] * 1000)
    assert float(rows[0][6]) == pytest.approx(0.35)
    assert float(rows[1][6]) == -1.0


def test_a_failing_disk_leaves_the_old_file_and_nothing_partial(tmp_path, monkeypatch):
    path = tmp_path / "poses.csv"
    poses_file.write_poses(path, ESTIMATES[:1])
    before = path.read_bytes()

    class FullDisk:
        def __init__(self, stream, **_):
            self.stream = stream

        def writerow(self, _):
            self.stream.write("half a row")
            self.stream.flush()
            assert len(list(tmp_path.iterdir())) == 2
            raise OSError("no space left")

    monkeypatch.setattr(poses_file.csv, "writer", FullDisk)
    with pytest.raises(OSError, match="no space"):
        poses_file.write_poses(path, ESTIMATES)
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["poses.csv"]


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


def test_absent_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"poses\.csv"):
        poses_file.read_poses(tmp_path / "poses.csv")
    with pytest.raises(FileNotFoundError, match=r"scores\.csv"):
        poses_file.read_scores(tmp_path / "scores.csv")


def _score(found):
    worst = float("inf")
    return TargetScore(
        6, 12, 1, found, 0.25, *((0.004, 0.1, 0.02) if found else (worst,) * 3),
        0.75 if found else 0.0, found, False, found, 0.5, 0.25,
    )  # fmt: skip


def test_scores_come_back_as_they_were(tmp_path):
    path = tmp_path / "scores.csv"
    poses_file.write_scores(path, [_score(True), _score(False)], {1: "ape"})
    rows = list(csv.DictReader(path.open()))
    assert rows[0]["object"] == "ape" and float(rows[0]["add_mm"]) == pytest.approx(4.0)
    assert float(rows[0]["rotation_deg"]) == pytest.approx(math.degrees(0.1))
    assert rows[1]["add_mm"] == "inf" and rows[1]["add_correct"] == "0"
    found, lost = poses_file.read_scores(path)
    for back, sent in ((found, _score(True)), (lost, _score(False))):
        for key in TargetScore.__dataclass_fields__:
            assert getattr(back, key) == pytest.approx(getattr(sent, key), nan_ok=True), key


def test_a_broken_score_is_an_error_that_names_the_line(tmp_path):
    path = tmp_path / "scores.csv"
    poses_file.write_scores(path, [_score(True)], {1: "ape"})
    path.write_text(path.read_text().replace(",0.25,", ",x,"))
    with pytest.raises(ValueError, match="line 2"):
        poses_file.read_scores(path)
