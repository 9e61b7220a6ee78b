import json

import numpy as np
import pytest

from hlp.geometry import rigid
from hlp.records import PoseEstimate
from hlp.reporting.tables.pose_table import format_poses, poses_json

QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
ESTIMATES = [
    PoseEstimate(0, 0, 1, rigid(QUARTER_TURN, np.array([0.01, -0.02, 0.8])), 0.875, {"total": 1.0}),
    PoseEstimate(0, 1, 1, None, 0.0, {"total": 1.0}),
]
IMAGES = ["a.png", "b.png"]


def test_table_holds_millimetres_and_degrees_and_says_what_was_not_found():
    _, _, found, missing = format_poses(ESTIMATES, IMAGES, {1: "bolt"}).splitlines()
    assert found.split() == [
        "a.png",
        "bolt",
        "0.88",
        "10.0",
        "-20.0",
        "800.0",
        "0.0",
        "0.0",
        "90.0",
    ]
    assert missing.split() == ["b.png", "bolt", "not", "found"]


def test_what_is_more_likely_wrong_than_right_is_not_found():
    unlikely = [PoseEstimate(0, 0, 1, rigid(QUARTER_TURN, np.zeros(3)), 0.25, {})]
    row = format_poses(unlikely, IMAGES[:1], {1: "bolt"}).splitlines()[-1]
    assert row.split() == ["a.png", "bolt", "not", "found", "(0.25)"]
    (pose,) = poses_json(unlikely, IMAGES[:1], {1: "bolt"})["poses"]
    assert not pose["found"] and pose["score"] == 0.25 and "cam_R_m2c" in pose


def test_json_holds_bops_names_and_units():
    first, second = json.loads(json.dumps(poses_json(ESTIMATES, IMAGES, {1: "bolt"})))["poses"]
    assert (first["rgb"], first["object"], first["found"], first["score"]) == (
        "a.png", "bolt", True, 0.875,
    )  # fmt: skip
    assert first["cam_t_m2c"] == pytest.approx([10.0, -20.0, 800.0])
    assert first["cam_R_m2c"] == QUARTER_TURN.ravel().tolist()
    assert not second["found"] and second["score"] == 0.0 and "cam_R_m2c" not in second
