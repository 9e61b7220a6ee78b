from dataclasses import replace

import numpy as np
import pytest

from hlp.checks.depth_ratio import check_depth_ratio, ratio_gains
from hlp.method.detections import Detection
from hlp.refinement.pose_fit import PoseFit


def finder(truth, cost_of_a_tenth=0.04, score=0.95):
    """Stands for a search: an answer costs the more, the farther depth is from the truth."""

    def find(frame):
        off = abs(np.log(np.median(frame.depth) / np.median(truth.depth))) / np.log(1 / 0.9)
        fit = PoseFit(0.2 + cost_of_a_tenth * off, 0.9, 0.9, 1.0, 1.0)
        return [Detection("cup", score, np.eye(4), 1.0, 0.0, 1.0, np.eye(4)[None], None, fit)]

    return find


def gains(frames, planted, **found):
    """Gains of frames whose depth is `planted` times the true one."""
    measured = []
    for truth in frames:
        find = finder(truth, **found)
        frame = replace(truth, depth=truth.depth * np.float32(planted))
        measured.append(ratio_gains(frame, find(frame), find))
    return measured


@pytest.mark.parametrize(("planted", "words"), [(0.9, "0.9 times"), (1 / 0.9, "1.1 times")])
def test_depth_that_is_a_tenth_off_is_named(frames, planted, words):
    (finding,) = check_depth_ratio(gains(frames, planted))
    assert finding.kind == "depth scale" and f"depth may be {words}" in finding.problem


def test_right_depth_has_no_finding(frames):
    measured = gains(frames, 1.0)
    assert [sorted(each) for each in measured] == [[0.9, 1 / 0.9]] * 3
    np.testing.assert_allclose([list(each.values()) for each in measured], -0.04, atol=1e-4)
    assert check_depth_ratio(measured) == []
    assert check_depth_ratio([]) == []


def test_small_gains_few_frames_and_uncertain_answers_say_nothing(frames):
    assert check_depth_ratio(gains(frames, 0.9, cost_of_a_tenth=0.01)) == []
    assert check_depth_ratio(gains(frames, 0.9)[:2]) == []
    assert gains(frames, 0.9, score=0.7) == [{}] * 3
    mixed = [{0.9: 0.1}, {0.9: 0.1}, {0.9: -0.01}, {0.9: 0.1}, {0.9: -0.01}]
    assert check_depth_ratio(mixed) == []
    assert len(check_depth_ratio(mixed[:4])) == 1
