from dataclasses import replace

import numpy as np
import pytest

from box_scene import SHAPE, at
from hlp.records import Frame, ObjectModel, PoseEstimate, Region, Target, TargetScore, Votes
from hlp.reporting.figures.panels import ESTIMATE_COLOR, TRUTH_COLOR
from hlp.reporting.figures.saving import LEGEND_HEIGHT, TITLE_HEIGHT
from hlp.reporting.figures.target_panels import SeenTarget, describe_target, draw_panels


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


def test_nothing_but_a_frame_is_enough(seen: SeenTarget) -> None:
    none = np.zeros((0, 3))
    empty = Votes(none, np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, int), np.zeros((0, 2)))
    bare = SeenTarget(seen.frame, seen.model, seen.region, empty)
    picture = draw_panels(bare)
    assert picture.shape == draw_panels(seen).shape
    assert count(picture[-SHAPE[0] : -LEGEND_HEIGHT, : SHAPE[1]], ESTIMATE_COLOR) == 0
    assert describe_target(bare) == "000001_000002  box: no pose"


def test_the_line_tells_verdict_errors_and_score(seen: SeenTarget) -> None:
    assert describe_target(seen) == (
        "000001_000002  box: right; ADD(-S) 3.1 mm (a tenth of the diameter: 17.2), 1.1 deg, "
        "3.0 mm; score 0.93; visible 0.87"
    )
    assert seen.score is not None
    wrong = replace(seen.score, add_correct=False, cause="no_votes")
    assert "box: wrong, no votes; ADD(-S)" in describe_target(replace(seen, score=wrong))
    missed = replace(wrong, found=False, visible_fraction=float("nan"))
    assert describe_target(replace(seen, score=missed)).endswith("box: missed, no votes")
