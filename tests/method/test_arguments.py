"""What a caller may give to a detector wrongly: an error that names the argument, no traceback."""

from pathlib import Path

import numpy as np
import pytest
import torch

from hlp.errors import InputError
from hlp.method.arguments import (
    check_limits,
    checked_backgrounds,
    checked_frame,
    checked_mask,
    checked_meshes,
    checked_names,
    checked_path,
    checked_pose,
)

RGB = np.full((24, 32, 3), 90, np.uint8)
DEPTH = np.full((24, 32), 0.8, np.float32)
K = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])


def camera(**changes):
    places = {"fx": (0, 0), "fy": (1, 1), "skew": (0, 1), "cx": (0, 2)}
    changed = K.copy()
    for name, value in changes.items():
        changed[places[name]] = value
    return changed


def frame(rgb=RGB, depth=DEPTH, camera_matrix=K):
    return lambda: checked_frame(rgb, depth, camera_matrix)


def limits(most=1, score=0.5):
    return lambda: check_limits(most, score)


def mask(given):
    return lambda: checked_mask(given, (24, 32))


def names(given):
    return lambda: checked_names(given, ["bear"], Path("learnt"))


def pose(given):
    return lambda: checked_pose(given)


GRADIENT = torch.full((24, 32), 0.8, requires_grad=True)
CASES = {
    "grey rgb": (frame(RGB[..., 0]), "rgb is uint8 (24, 32): it must be uint8"),
    "rgb of fractions": (frame(RGB / 255.0), "rgb is float64"),
    "depth of integers": (frame(depth=(DEPTH * 1000).astype(np.uint16)), "in metres; for millim"),
    "depth in millimetres": (frame(depth=DEPTH * 1000), "is it in mm?"),
    "smaller depth": (frame(depth=DEPTH[:-1]), "they must be alike"),
    "negative depth": (frame(depth=-DEPTH), "depth has negative values"),
    "transposed camera": (frame(camera_matrix=K.T), "it must be fx 0 cx 0 fy cy"),
    "camera of a larger image": (frame(camera_matrix=camera(cx=1000)), "lies outside the image"),
    "mirrored camera": (frame(camera_matrix=camera(fx=-30)), "must be finite and positive"),
    "ragged rgb": (frame([[1, 2], [3]]), "rgb is not an array"),
    "depth with gradients": (frame(depth=GRADIENT), "depth is not an array"),
    "sparse depth": (frame(depth=GRADIENT.detach().to_sparse()), "depth is not an array"),
    "depth in kilometres": (frame(depth=DEPTH / 1000), "nowhere more than 0.0008 m"),
    "one pixel": (frame(RGB[:1, :1], DEPTH[:1, :1], np.eye(3)), "8 pixels a side"),
    "complex camera": (frame(camera_matrix=K.astype(complex)), "camera_matrix must be 3 × 3 num"),
    "ragged camera": (frame(camera_matrix=[[1], [2, 3]]), "camera_matrix is not an array"),
    "skewed camera": (frame(camera_matrix=camera(skew=5)), "it must be fx 0 cx 0 fy cy"),
    "huge focal length": (frame(camera_matrix=camera(fx=1e9, fy=1e9)), "must be 3.2 to 640"),
    "one wrong focal length": (frame(camera_matrix=camera(fy=1)), "and 1 px"),
    "half an instance": (limits(1.5), "max_instances is 1.5"),
    "instances: true": (limits(True), "max_instances is True"),
    "score in words": (limits(score="0.5"), "min_score is '0.5'"),
    "score above 1": (limits(score=2), "min_score is 2"),
    "ragged mask": (mask([[True], [False, True]]), "mask is not an array"),
    "pose: NaN": (pose(np.full((4, 4), np.nan)), "pose_cam_obj must be 4 × 4 finite"),
    "transposed pose": (pose([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]), "last row"),
    "pose in mm": (pose([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 917], [0, 0, 0, 1]]), "is 917 m"),
    "absurd pose": (pose([[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]), "1e+300"),
    "scaled pose": (pose(np.diag([2.0, 2.0, 2.0, 1.0])), "is not a rotation: its rows"),
    "names: a number": (names(5), "objects is 5: give a list"),
    "names: lists": (names([["bear"]]), "objects: ['bear'] not learnt; learnt has bear"),
    "meshes: a list": (lambda: checked_meshes(["a.ply"]), "it must map names to files"),
    "meshes: a number as name": (lambda: checked_meshes({1: "a.ply"}), "it must map names"),
    "meshes: no path": (lambda: checked_meshes({"a": None}), "meshes['a'] is None: it must be a"),
    "folder: zero byte": (lambda: checked_path("a\0b", "folder"), "it must be a path"),
    "folder: null": (lambda: checked_path(None, "folder"), "folder is None: it must be a path"),
    "backgrounds: a number": (lambda: checked_backgrounds(5), "background_frames: they must be"),
    "backgrounds: images": (lambda: checked_backgrounds([RGB]), "background_frames: they must be"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_wrong_argument_is_named(case):
    call, words = CASES[case]
    with pytest.raises(InputError) as caught:
        call()
    assert words in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    "depth",
    [
        np.asfortranarray(DEPTH),
        DEPTH.astype(">f4"),
        np.repeat(DEPTH, 2, axis=1)[:, ::2],
        torch.from_numpy(DEPTH),
    ],
)
def test_the_layout_of_an_array_does_not_matter(depth):
    given = checked_frame(np.asfortranarray(RGB), depth, K.tolist())
    assert given.depth.dtype == np.float32 and np.array_equal(given.depth, DEPTH)
    assert np.array_equal(given.rgb, RGB) and np.array_equal(given.camera_matrix, K)


def test_what_is_masked_or_no_distance_is_missing():
    marked = np.ma.masked_array(DEPTH.astype(np.float64), mask=np.zeros(DEPTH.shape, bool))
    marked[3, 4] = np.ma.masked
    marked[5, 6] = 1e300  # infinite in single precision
    missing = np.argwhere(checked_frame(RGB, marked, K).depth == 0.0).tolist()
    assert missing == [[3, 4], [5, 6]]
