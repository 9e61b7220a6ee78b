"""What a caller may give to a detector wrongly: an error that names the argument, no traceback."""

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
    checked_settings,
)
from hlp.method.settings import TrackingSettings

RGB = np.full((24, 32, 3), 90, np.uint8)
DEPTH = np.full((24, 32), 0.8, np.float32)
K = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])


def camera(row, column, value):
    changed = K.copy()
    changed[row, column] = value
    return changed


def frame(rgb=RGB, depth=DEPTH, camera_matrix=K):
    return rgb, depth, camera_matrix


def moved(x):
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


GRADIENT = torch.full((24, 32), 0.8, requires_grad=True)
RAGGED = [[True], [False, True]]
CASES = [
    (checked_frame, frame(RGB[..., 0]), "rgb is uint8 (24, 32): it must be uint8"),
    (checked_frame, frame(RAGGED), "rgb is not an array"),
    (checked_frame, frame(depth=(DEPTH * 1000).astype(np.uint16)), "in metres; for millim"),
    (checked_frame, frame(depth=DEPTH * 1000), "is it in mm?"),
    (checked_frame, frame(depth=DEPTH / 1000), "nowhere more than 0.0008 m"),
    (checked_frame, frame(depth=DEPTH[:-1]), "they must be alike"),
    (checked_frame, frame(depth=-DEPTH), "depth has negative values"),
    (checked_frame, frame(depth=GRADIENT), "depth is not an array"),
    (checked_frame, frame(RGB[:1, :1], DEPTH[:1, :1], np.eye(3)), "8 pixels a side"),
    (checked_frame, frame(camera_matrix=camera(0, 2, 1000)), "lies outside the image"),
    (checked_frame, frame(camera_matrix=camera(0, 0, -30)), "must be finite and positive"),
    (checked_frame, frame(camera_matrix=camera(0, 1, 5)), "it must be fx 0 cx 0 fy cy"),
    (checked_frame, frame(camera_matrix=K.astype(complex)), "camera_matrix must be 3 × 3 num"),
    (check_limits, (1.5, 0.5), "max_instances is 1.5"),
    (check_limits, (True, 0.5), "max_instances is True"),
    (check_limits, (1, "0.5"), "min_score is '0.5'"),
    (check_limits, (1, 2), "min_score is 2"),
    (checked_mask, (RAGGED, (24, 32)), "mask is not an array"),
    (checked_mask, (DEPTH, (24, 32)), "mask is float32 (24, 32): it must be bool (24, 32)"),
    (checked_mask, (DEPTH > 1.0, (24, 32)), "mask covers no pixel"),
    (checked_pose, (np.full((4, 4), np.nan),), "pose_cam_obj must be 4 × 4 finite"),
    (checked_pose, (moved(0.5).T,), "last row"),
    (checked_pose, (moved(917),), "is 917 m"),
    (checked_pose, (moved(1e300),), "1e+300"),
    (checked_pose, (np.diag([2.0, 2.0, 2.0, 1.0]),), "is not a rotation: its rows"),
    (checked_names, (5, ["bear"], "learnt"), "objects is 5: give a list"),
    (checked_names, ([["bear"]], ["bear"], "learnt"), "['bear'] not learnt; learnt has bear"),
    (checked_meshes, (["a.ply"],), "it must map names to files"),
    (checked_meshes, ({"a": None},), "meshes['a'] is None: it must be a"),
    (checked_path, ("a\0b", "folder"), "it must be a path"),
    (checked_backgrounds, (5,), "background_frames: they must be"),
    (checked_backgrounds, ([RGB],), "background_frames: they must be"),
    (checked_settings, ("fast", TrackingSettings), "settings is 'fast': it must be TrackingSett"),
]


@pytest.mark.parametrize(("call", "given", "words"), CASES)
def test_a_wrong_argument_is_named(call, given, words):
    with pytest.raises(InputError) as caught:
        call(*given)
    assert words in str(caught.value)


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
    given = checked_frame(np.asfortranarray(RGB), depth, np.asfortranarray(K))
    assert all(array.flags.c_contiguous for array in (given.rgb, given.depth, given.camera_matrix))
    assert given.depth.dtype == np.float32 and np.array_equal(given.depth, DEPTH)
    assert np.array_equal(given.rgb, RGB) and np.array_equal(given.camera_matrix, K)


def test_what_is_masked_or_no_distance_is_missing():
    marked = np.ma.masked_array(DEPTH.astype(np.float64), mask=np.zeros(DEPTH.shape, bool))
    marked[3, 4] = np.ma.masked
    marked[5, 6] = 1e300  # infinite in single precision
    marked[7, 8] = np.nan
    missing = np.argwhere(checked_frame(RGB, marked, K).depth == 0.0).tolist()
    assert missing == [[3, 4], [5, 6], [7, 8]]
