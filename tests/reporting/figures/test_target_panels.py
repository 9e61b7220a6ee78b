from dataclasses import replace

import numpy as np
import pytest

from box_scene import CAMERA, SHAPE, at
from hlp.geometry import project
from hlp.records import Frame, ObjectModel, PoseEstimate, Region, Target, TargetScore, Votes
from hlp.rendering.rasterizer import render_depth
from hlp.reporting.figures import LEGEND_HEIGHT, TITLE_HEIGHT
from hlp.reporting.figures.panels import ESTIMATE_COLOR, TRUTH_COLOR
from hlp.reporting.figures.target_panels import (
    LIMIT_MM,
    RIGHT_COLOR,
    WRONG_COLOR,
    SeenTarget,
    color_differences,
    describe_target,
    draw_overview,
    draw_panels,
    enlarge,
)


@pytest.fixture
def seen(shot: Frame, box: ObjectModel) -> SeenTarget:
    votes = Votes(
        np.array([[0.05, 0.0, 0.8], [0.05, 0.0, 0.8], [-0.2, 0.1, 0.9]]),
        np.repeat(np.eye(3)[None], 3, axis=0),
        np.array([1.0, 2.0, 0.5]),
        np.arange(3),
        np.array([[170.0, 120.0], [180.0, 110.0], [100.0, 150.0]]),
    )
    region = Region(1, np.zeros((3, 2)), np.ones(3), np.ones(SHAPE, dtype=bool))
    estimate = PoseEstimate(1, 2, 1, at(0.05, 0.003, 0.8), 0.93)
    score = TargetScore(1, 2, 1, True, 0.87, 0.0031, 0.02, 0.003, 0.9, True, True, True, score=0.93)
    truth = Target(1, at(0.05, 0.0, 0.8), 0.87)
    return SeenTarget(shot, box, region, votes, at(0.06, 0.01, 0.82), estimate, truth, score)


def count(picture: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((np.abs(picture.astype(int) - color).sum(axis=2) < 12).sum())


def test_six_panels_show_answer_and_truth(seen: SeenTarget) -> None:
    picture = draw_panels(seen)
    height, width = SHAPE
    assert picture.shape[1] == 3 * width
    assert picture.shape[0] == 2 * (height + TITLE_HEIGHT + LEGEND_HEIGHT) + 36
    lower = picture[-height - LEGEND_HEIGHT : -LEGEND_HEIGHT]
    for panel in (lower[:, :width], lower[:, width : 2 * width]):  # pose, close-up
        assert count(panel, ESTIMATE_COLOR) > 30
        assert count(panel, TRUTH_COLOR) > 30


def test_without_an_answer_and_votes_the_truth_is_shown(seen: SeenTarget) -> None:
    none = np.zeros((0, 3))
    empty = Votes(none, np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, int), np.zeros((0, 2)))
    picture = draw_panels(replace(seen, votes=empty, coarse=None, estimate=None))
    assert picture.shape == draw_panels(seen).shape
    pose = picture[-SHAPE[0] : -LEGEND_HEIGHT, : SHAPE[1]]
    assert count(pose, ESTIMATE_COLOR) == 0 and count(pose, TRUTH_COLOR) > 30


def test_the_line_tells_verdict_errors_and_score(seen: SeenTarget) -> None:
    assert describe_target(seen) == (
        "000001_000002  box: right; ADD(-S) 3.1 mm (a tenth of the diameter: 17.2), 1.1 deg, "
        "3.0 mm; score 0.93; visible 0.87"
    )
    wrong = replace(seen.score, add_correct=False, cause="no_votes")
    assert "box: wrong, no votes; ADD(-S)" in describe_target(replace(seen, score=wrong))
    missed = replace(wrong, found=False, visible_fraction=float("nan"))
    assert describe_target(replace(seen, score=missed)).endswith("box: not found, no votes")


def test_what_is_enlarged_fits_its_camera(shot: Frame, box: ObjectModel) -> None:
    pose = at(0.05, 0.0, 0.8)
    near = enlarge(shot, box, [pose])
    assert near.rgb.shape == shot.rgb.shape
    scale = near.camera_matrix[0, 0] / CAMERA[0, 0]
    assert 2.0 < scale < 6.0
    (center,) = project(pose[None, :3, 3], near.camera_matrix)
    np.testing.assert_allclose(center, (159.5, 119.5), atol=12)  # the nearer face is larger
    rendered = render_depth(box.mesh, pose[None], near.camera_matrix, SHAPE)[0]
    observed = (near.depth > 0) & (near.depth < 1.0)
    both, either = (rendered > 0) & observed, (rendered > 0) | observed
    assert both.sum() / either.sum() > 0.97
    assert np.median(np.abs(rendered - near.depth)[both]) < 1e-6


def test_what_cannot_be_seen_is_not_enlarged(shot: Frame, box: ObjectModel) -> None:
    assert enlarge(shot, box, []) is shot
    assert enlarge(shot, box, [at(0, 0, -1.0)]) is shot


def test_differences_are_blue_before_and_red_behind_and_white_between() -> None:
    observed = np.array([[1.0, 1.0, 1.0, 0.0, 1.0]])
    shift = LIMIT_MM / 1000
    rendered = np.array([[1.0 - shift, 1.0, 1.0 + 3 * shift, 1.0, 0.0]])
    colors = color_differences(rendered, observed)[0].astype(int)
    assert colors[0, 2] > colors[0, 0] + 60
    assert (colors[1] > 240).all()
    assert colors[2, 0] > colors[2, 2] + 60
    np.testing.assert_array_equal(colors[3], colors[4])
    assert colors[3].max() < 60


def test_right_and_wrong_poses_are_outlined_in_their_colours(seen: SeenTarget) -> None:
    assert seen.estimate is not None
    targets = [
        replace(
            seen,
            estimate=replace(seen.estimate, pose_cam_obj=at(x, 0.0, 0.8)),
            score=replace(seen.score, add_correct=right),
        )
        for x, right in ((-0.2, False), (0.2, True))
    ]
    lost = replace(seen, estimate=None, score=replace(seen.score, add_correct=False))
    picture = draw_overview(seen.frame, [*targets, lost])
    assert picture.shape[1] == SHAPE[1]
    frame = picture[-SHAPE[0] - 20 : -20]
    left, right = frame[:, :160], frame[:, 160:]
    assert count(left, WRONG_COLOR) > 30 and count(left, RIGHT_COLOR) == 0
    assert count(right, RIGHT_COLOR) > 30 and count(right, WRONG_COLOR) == 0
