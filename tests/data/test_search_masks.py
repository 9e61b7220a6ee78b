from pathlib import Path

import cv2
import numpy as np
import pytest

from hlp.data.frame_paths import FramePaths
from hlp.data.own_frames import SearchMasks

FRAME = FramePaths(Path("rgb/a.png"), Path("depth/a.png"))


def test_a_box_is_x_y_width_height_cut_at_the_border():
    mask = SearchMasks(box=(3, 2, 4, 5)).load(FRAME, (20, 10))
    expected = np.zeros((20, 10), bool)
    expected[2:7, 3:7] = True
    np.testing.assert_array_equal(mask, expected)
    assert SearchMasks(box=(-5, -5, 7, 6)).load(FRAME, (20, 10)).sum() == 2
    with pytest.raises(ValueError, match="lies outside"):
        SearchMasks(box=(30, 2, 4, 5)).load(FRAME, (20, 10))


def test_a_mask_is_what_is_not_black(tmp_path):
    image = np.zeros((20, 10), np.uint8)
    image[5:8, 2:4] = 1
    cv2.imwrite(str(tmp_path / "a.png"), image)
    cv2.imwrite(str(tmp_path / "b.png"), np.dstack([image * 0, image * 9, image * 0]))
    for given in (tmp_path, tmp_path / "a.png", tmp_path / "b.png"):
        np.testing.assert_array_equal(SearchMasks(str(given)).load(FRAME, (20, 10)), image > 0)


def test_what_is_no_mask_of_the_frame_is_named(tmp_path):
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((20, 10), np.uint8))
    with pytest.raises(FileNotFoundError, match=r"has no a\.png"):
        SearchMasks(str(tmp_path)).load(FRAME, (20, 10))
    with pytest.raises(ValueError, match="must be alike"):
        SearchMasks(str(tmp_path / "b.png")).load(FRAME, (10, 10))
    with pytest.raises(ValueError, match="marks no pixel"):
        SearchMasks(str(tmp_path / "b.png")).load(FRAME, (20, 10))
