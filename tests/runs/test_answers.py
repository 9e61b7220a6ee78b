import numpy as np
from scipy.spatial.transform import Rotation

from hlp.method.find.detections import Detection
from hlp.refinement.pose_fit import PoseFit
from hlp.runs import answers

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([10.0, -20.0, 30.0], degrees=True).as_matrix()
POSE[:3, 3] = [0.1, -0.25, 0.7]


def test_a_line_holds_translation_and_rotation_vector_below_the_header():
    line = answers.pose_line("a", "bolt", 0.876, POSE)
    numbers = [float(word) for word in line.split()[2:]]
    assert numbers == [0.88, 100.0, -250.0, 700.0, 10.0, -20.0, 30.0]
    assert line.split()[:2] == ["a", "bolt"]
    assert len(line) == len(answers.HEADER)


def test_a_pose_has_the_keys_of_bop():
    fit = PoseFit(0.1, 0.9, 0.9, 1.0, 1.0)
    found = Detection("bolt", 0.876, POSE, 0.9, 0.1, 1.5, POSE[None], None, fit)
    values = answers.detection_values(found)
    np.testing.assert_array_equal(np.reshape(values.pop("cam_R_m2c"), (3, 3)), POSE[:3, :3])
    assert values == {
        "score": 0.876,
        "cam_t_m2c": [100.0, -250.0, 700.0],
        "visible_fraction": 0.9,
        "residual_mm": 1.5,
    }


def test_what_is_not_found_says_why():
    assert answers.missing_line("a", "bolt", "too far").split(maxsplit=2)[2] == "not found: too far"
