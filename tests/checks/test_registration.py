from dataclasses import replace

import numpy as np
import pytest

from hlp.checks.frame_checks import check_registration


@pytest.mark.parametrize("shift", [(10, 0), (-10, 0), (0, 12), (8, -8)])
def test_shifted_depth_is_named_with_the_shift_back(frames, shift):
    moved = [
        replace(each, depth=np.roll(each.depth, (shift[1], shift[0]), axis=(0, 1)))
        for each in frames
    ]
    (finding,) = check_registration(moved)
    assert finding.kind == "registration"
    x, y = (int(part) for part in finding.problem.split("(")[1].split(")")[0].split(","))
    assert abs(x + shift[0]) <= 1 and abs(y + shift[1]) <= 1


def test_registered_depth_has_no_finding_nor_has_an_image_without_edges(frames):
    assert check_registration(frames) == []
    assert check_registration(frames[:1]) == []
    flat = replace(frames[0], depth=np.ones_like(frames[0].depth))
    assert check_registration([flat]) == []
    assert check_registration([]) == []


def test_noise_has_no_finding():
    rng = np.random.default_rng(0)
    for _ in range(2):
        frame = type("F", (), {})()
        frame.rgb = rng.integers(0, 255, (120, 160, 3)).astype(np.uint8)
        frame.depth = rng.uniform(0.5, 1.5, (120, 160)).astype(np.float32)
        assert check_registration([frame]) == []
