"""Where depth lies in the colour image: shifted, of another camera, or in its own place."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from hlp.checks.registration import Registration, check_registration, find_registration
from hlp.records import Frame

K = np.array([[60.0, 0, 32], [0, 61, 23], [0, 0, 1]])


@pytest.mark.parametrize("shift", [(10, 0), (-10, 0), (0, 12), (8, -8)])
def test_shifted_depth_is_named_with_the_shift_back(frames, shift):
    moved = [
        replace(frame, depth=np.roll(frame.depth, (shift[1], shift[0]), axis=(0, 1)))
        for frame in frames
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
    rgb = rng.integers(0, 255, (120, 160, 3)).astype(np.uint8)
    depth = rng.uniform(0.5, 1.5, (120, 160)).astype(np.float32)
    assert check_registration([Frame(0, 0, rgb, depth, np.eye(3))]) == []


def test_depth_of_another_camera_is_named_with_its_intrinsics(frames):
    """As of a camera whose depth is not registered: smaller, higher and turned."""
    size = frames[0].depth.shape[::-1]
    for turn in (0.0, 3.0):
        motion = cv2.getRotationMatrix2D(((size[0] - 1) / 2, (size[1] - 1) / 2), turn, 0.75)
        motion[1, 2] -= 20
        moved = [replace(f, depth=cv2.warpAffine(f.depth, motion, size, flags=0)) for f in frames]
        found = find_registration(moved, whole=True)
        assert abs(found.scale - 4 / 3) < 0.05 and abs(found.turn - turn) <= 1.5
        assert abs(found.down - 20 * 4 / 3) <= 4 and abs(found.right) <= 4
        back = found.frame(moved[0])
        both = (back.depth > 0) & (frames[0].depth > 0)
        assert np.median(np.abs(back.depth - frames[0].depth)[both]) < 0.01
    (finding,) = check_registration(moved, whole=True)
    assert "depth_intrinsics" not in finding.advice
    assert find_registration(frames, whole=True) is None


def test_the_depth_intrinsics_show_the_same_pixels():
    frame = Frame(0, 0, np.zeros((48, 64, 3), np.uint8), np.zeros((48, 64), np.float32), K)
    place = Registration(1.25, 0.0, 4, -6)
    fx, fy, cx, cy = map(float, re.findall(r"[-\d.]+", place.depth_intrinsics(frame)))
    ray = np.array([0.1, -0.05])
    seen = place.motion((64, 48)) @ [*(ray * [fx, fy] + [cx, cy]), 1.0]
    np.testing.assert_allclose(seen, ray * [K[0, 0], K[1, 1]] + K[:2, 2], atol=0.1)
