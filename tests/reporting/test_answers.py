import numpy as np
from scipy.spatial.transform import Rotation

from hlp.reporting import answers


def test_a_line_holds_translation_and_rotation_vector_below_the_header():
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([10.0, -20.0, 30.0], degrees=True).as_matrix()
    pose[:3, 3] = [0.1, -0.25, 0.7]
    line = answers.pose_line("a", "bolt", 0.876, pose)
    assert line.split() == [
        "a",
        "bolt",
        "0.88",
        "100.0",
        "-250.0",
        "700.0",
        "10.0",
        "-20.0",
        "30.0",
    ]
    assert len(line) == len(answers.HEADER)
    values = answers.pose_values(pose)
    np.testing.assert_array_equal(np.reshape(values["cam_R_m2c"], (3, 3)), pose[:3, :3])
    assert values["cam_t_m2c"] == [100.0, -250.0, 700.0]


def test_what_is_not_found_says_why():
    assert answers.missing_line("a", "bolt", "too far").split(maxsplit=2)[2] == "not found: too far"
