import json

import numpy as np
import pytest

from hlp.errors import InputError
from hlp.records import PoseEstimate
from hlp.results.poses_file import AnswersFile, read_poses, write_poses

POSE = np.array([[0, -1, 0, 0.1], [1, 0, 0, -0.2], [0, 0, 1, 0.7], [0, 0, 0, 1.0]])
ESTIMATE = PoseEstimate(0, 3, 1, POSE, 0.75, {"total": 0.125})


def test_every_answer_is_on_disk_at_once(tmp_path):
    with AnswersFile(tmp_path / "out") as file:
        file.add({"im_id": 3, "found": True}, ESTIMATE)
        (line,) = (tmp_path / "out" / "poses.jsonl").read_text().splitlines()
        assert json.loads(line) == {"im_id": 3, "found": True}
        (read,) = read_poses(tmp_path / "out" / "poses.csv")
        np.testing.assert_allclose(read.pose_cam_obj, POSE)
        file.add({"im_id": 4, "found": False}, None)
    write_poses(tmp_path / "whole.csv", [ESTIMATE])
    assert (tmp_path / "whole.csv").read_text() == (tmp_path / "out" / "poses.csv").read_text()
    poses = json.loads((tmp_path / "out" / "poses.json").read_text())["poses"]
    assert [pose["im_id"] for pose in poses] == [3, 4]


def test_an_interrupted_call_leaves_the_lines_and_no_old_document(tmp_path):
    with AnswersFile(tmp_path):
        pass
    assert json.loads((tmp_path / "poses.json").read_text()) == {"poses": []}
    try:
        with AnswersFile(tmp_path) as file:
            file.add({"im_id": 1}, None)
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        pass
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
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "poses.csv",
        "poses.json",
        "poses.jsonl",
    ]
