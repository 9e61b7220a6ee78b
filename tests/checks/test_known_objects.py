"""What known objects tell of frames: order and shift of colours."""

from dataclasses import replace

import numpy as np
import pytest

from faults import exchanged
from hlp.checks.known_objects import (
    check_color_order,
    colored_answers,
    exchange_gain,
)
from hlp.method.find.detections import Detection
from hlp.refinement.pose_fit import PoseFit

FITS = PoseFit(cost=0.2, depth_correlation=0.95, slope=0.9, residual_mm=1.0, visible_fraction=1.0)


@pytest.fixture(scope="module")
def named(models):
    return {model.name: model for model in models.values()}


@pytest.fixture(scope="module")
def grey(named):
    return {
        name: replace(model, mesh=replace(model.mesh, colored=False))
        for name, model in named.items()
    }


def answers(frame, models, fit=FITS, score=0.9, visible=0.0):
    """The true poses of what is seen that well, as a search would answer."""
    return [
        Detection(
            models[target.object_id].name, score, target.pose_cam_obj, 1.0, 0.0, 1.0,
            target.pose_cam_obj[None], None, fit,
        )
        for target in frame.targets
        if target.visible_fraction > visible
    ]  # fmt: skip


def test_colours_are_compared_where_the_shape_fits(frames, models, named, grey):
    good = answers(frames[0], models)[0]
    bad = [replace(good, fit=replace(FITS, **{key: 0.7})) for key in ("depth_correlation", "slope")]
    assert colored_answers(named, [good, *bad]) == [good]
    assert colored_answers(grey, [good]) == []


def test_exchanged_colours_are_found_and_true_ones_are_not(frames, models, named):
    placed = [
        [(models[target.object_id], target.pose_cam_obj) for target in frame.targets]
        for frame in frames
    ]
    true = list(map(exchange_gain, frames, placed))
    wrong = list(map(exchange_gain, map(exchanged, frames), placed))
    np.testing.assert_allclose(true, np.negative(wrong), atol=1e-6)
    assert check_color_order(true) == []
    (finding,) = check_color_order(wrong)
    assert finding.kind == "colours" and finding.where == "3 frames"


def test_grey_objects_say_nothing(frames, grey):
    pose = frames[0].targets[0].pose_cam_obj
    assert exchange_gain(frames[0], [(model, pose) for model in grey.values()]) is None
    assert exchange_gain(frames[0], []) is None


@pytest.mark.parametrize(
    ("gains", "count"),
    [([1.0, 1.0], 1), ([0.7, 1.0], 0), ([1.0, None], 0), ([1.0], 1), ([0.7], 0), ([None], 0),
     ([1.0, 1.0, None, None], 1), ([1.0, None, None], 0), ([1.0, 0.9, 0.8], 1),
     ([0.3, 0.4, 0.3], 0), ([3.0, 3.0, -0.1, -0.1], 0),
     ([-1.0, -1.0, -1.0], 0), ([1.0, 1.0, 1.0, -0.1], 1), ([], 0)],
)  # fmt: skip
def test_three_frames_must_say_so_clearly_and_fewer_more_clearly(gains, count):
    assert len(check_color_order(gains)) == count
