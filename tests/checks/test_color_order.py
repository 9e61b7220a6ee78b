from dataclasses import replace

import numpy as np
import pytest

from hlp.checks.known_objects import check_color_order, exchange_gain
from hlp.method.find.detections import Detection
from hlp.refinement.pose_fit import PoseFit

FITS = PoseFit(cost=0.2, relief=0.95, slope=0.9, residual_mm=1.0, visible_fraction=1.0)


def answers(frame, models, fit=FITS):
    """The true poses, as a search would answer."""
    return [
        Detection(
            models[each.object_id].name, 0.1, each.pose_cam_obj, 1.0, 0.0, 1.0,
            each.pose_cam_obj[None], None, fit,
        )
        for each in frame.targets
    ]  # fmt: skip


@pytest.fixture
def named(models):
    return {each.name: each for each in models.values()}


def exchanged(frame):
    return replace(frame, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))


def test_exchanged_colours_are_found_and_true_ones_are_not(frames, models, named):
    true = [exchange_gain(each, named, answers(each, models)) for each in frames]
    wrong = [exchange_gain(exchanged(each), named, answers(each, models)) for each in frames]
    np.testing.assert_allclose(true, np.negative(wrong), atol=1e-6)
    assert check_color_order(true) == []
    (finding,) = check_color_order(wrong)
    assert finding.kind == "colours" and finding.where == "3 frames"


def test_wrong_poses_and_grey_objects_say_nothing(frames, models, named):
    wrong = replace(FITS, slope=0.5)
    assert exchange_gain(frames[0], named, answers(frames[0], models, wrong)) is None
    grey = {
        name: replace(each, mesh=replace(each.mesh, colored=False)) for name, each in named.items()
    }
    assert exchange_gain(frames[0], grey, answers(frames[0], models)) is None
    assert exchange_gain(frames[0], named, []) is None


@pytest.mark.parametrize(
    ("gains", "count"),
    [([1.0, 1.0], 1), ([0.7, 1.0], 0), ([1.0, None], 0), ([1.0], 1), ([0.7], 0), ([None], 0),
     ([1.0, 1.0, None, None], 1), ([1.0, None, None], 0), ([1.0, 0.9, 0.8], 1),
     ([0.3, 0.4, 0.3], 0), ([3.0, 3.0, -0.1, -0.1], 0),
     ([-1.0, -1.0, -1.0], 0), ([1.0, 1.0, 1.0, -0.1], 1), ([], 0)],
)  # fmt: skip
def test_three_frames_must_say_so_clearly_and_fewer_more_clearly(gains, count):
    assert len(check_color_order(gains)) == count
