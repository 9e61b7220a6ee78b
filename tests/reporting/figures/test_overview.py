import numpy as np

from box_scene import SHAPE, at
from hlp.records import Frame, ObjectModel
from hlp.reporting.figures.tiles import RIGHT_COLOR, WRONG_COLOR, ShownPose, draw_overview


def test_right_and_wrong_poses_are_outlined_in_their_colours(shot: Frame, box: ObjectModel) -> None:
    poses = [
        ShownPose(box, at(-0.2, 0.0, 0.8), "box 0.10", False),
        ShownPose(box, at(0.2, 0.0, 0.8), "box 0.90", True),
    ]
    picture = draw_overview(shot, poses, "1 of 2 targets right").astype(int)
    assert picture.shape[1] == SHAPE[1]
    frame = picture[-SHAPE[0] - 20 : -20]
    left, right = frame[:, :160], frame[:, 160:]
    assert (np.abs(left - WRONG_COLOR).sum(axis=2) < 12).sum() > 30
    assert (np.abs(left - RIGHT_COLOR).sum(axis=2) < 12).sum() == 0
    assert (np.abs(right - RIGHT_COLOR).sum(axis=2) < 12).sum() > 30
    assert (np.abs(right - WRONG_COLOR).sum(axis=2) < 12).sum() == 0
