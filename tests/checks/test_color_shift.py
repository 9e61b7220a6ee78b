from dataclasses import replace

import numpy as np
import pytest

from hlp.checks.known_objects import check_color_shift, shift_agreements
from hlp.method.find.detections import Detection
from hlp.refinement.pose_fit import PoseFit


@pytest.fixture
def named(models):
    return {each.name: each for each in models.values()}


def answers(frame, models, score=0.9):
    """The true poses of what is seen well, as a search would answer."""
    fit = PoseFit(0.2, 0.9, 0.9, 1.0, 1.0)
    return [
        Detection(
            models[each.object_id].name, score, each.pose_cam_obj, 1.0, 0.0, 1.0,
            each.pose_cam_obj[None], None, fit,
        )
        for each in frame.targets
        if each.visible_fraction > 0.7
    ]  # fmt: skip


def shifted(frame, right, down):
    """The frame with its colours moved, as if depth had been moved the other way."""
    return replace(frame, rgb=np.roll(frame.rgb, (down, right), axis=(0, 1)))


@pytest.mark.parametrize(("right", "down"), [(10, 0), (-10, 0), (0, 10), (5, -10)])
def test_a_shift_is_named(frames, models, named, right, down):
    found = [
        shift_agreements(shifted(each, right, down), named, answers(each, models))
        for each in frames
    ]
    (finding,) = check_color_shift(found)
    assert finding.kind == "registration" and finding.where == "3 frames"
    assert f"by about ({right}, {down}) px" in finding.problem


def test_registered_images_have_no_finding(frames, models, named):
    found = [shift_agreements(each, named, answers(each, models)) for each in frames]
    assert all(each.shape == (5, 5) and each.argmax() == 12 for each in found)
    assert check_color_shift(found) == []
    assert check_color_shift([]) == []


def test_few_frames_small_gains_and_uncertain_answers_say_nothing(frames, models, named):
    one = np.full((5, 5), 0.5)
    far, near = one.copy(), one.copy()
    far[0, 0], near[2, 3] = 0.545, 0.9
    diagonal = one.copy()
    diagonal[1, 1] = 0.9
    assert check_color_shift([far] * 2) == check_color_shift([far]) == []
    assert [each.where for each in check_color_shift([far + 2 * (far - one)])] == [
        "this frame alone"
    ]
    assert check_color_shift([far + 2 * (far - one), None]) == []
    assert check_color_shift([diagonal]) == []
    assert len(check_color_shift([diagonal] * 3)) == 1
    assert len(check_color_shift([far] * 3)) == 1
    assert check_color_shift([near] * 3) == []  # 5 px: cameras are that far off
    assert check_color_shift([far, one, one, one]) == []
    assert shift_agreements(frames[0], named, answers(frames[0], models, score=0.75)) is None
    assert shift_agreements(frames[0], named, []) is None
