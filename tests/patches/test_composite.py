"""The compiled composite against plain NumPy and SciPy, one operation at a time."""

import numpy as np
import pytest
from scipy.ndimage import convolve

from hlp.patches.composite import NOISE_LENGTH, BackgroundPool, ObjectWindows, compose_windows
from hlp.patches.holistic import Windows, cut_windows
from hlp.patches.holistic_data import draw_composites

COUNT, SIZE, BACKGROUNDS = 60, 32, 7
NOISE = np.random.default_rng(5).standard_normal(NOISE_LENGTH, dtype=np.float32)


def make_windows():
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (COUNT, SIZE, SIZE, 3)).astype(np.uint8)
    code = rng.integers(1, 256, (COUNT, SIZE, SIZE)).astype(np.uint8)
    mask = rng.random((COUNT, SIZE, SIZE)) < 0.6
    behind = rng.integers(0, 256, (BACKGROUNDS, SIZE, SIZE, 3)).astype(np.uint8)
    behind_code = rng.integers(1, 256, (BACKGROUNDS, SIZE, SIZE)).astype(np.uint8)
    behind_code[:3] = 0  # photographs
    return color, code, mask, behind, behind_code


def draws(seed=1):
    return draw_composites(np.random.default_rng(seed), COUNT, SIZE, BACKGROUNDS, 0.25)


def composed(drawn, with_depth=True, threads=1):
    made = make_windows()
    windows, behind = ObjectWindows(*made[:3]), BackgroundPool(*made[3:])
    return compose_windows(windows, behind, drawn, NOISE, with_depth, threads)


def smooth(grid):
    """Bilinear between the centres of the grid's cells, held beyond the outermost."""
    at = (np.arange(SIZE) + 0.5) * len(grid) / SIZE - 0.5
    cells = np.arange(len(grid))
    rows = np.stack([np.interp(at, cells, column) for column in grid.T], axis=1)
    return np.stack([np.interp(at, cells, row) for row in rows])


def plane(draw):
    axis = np.linspace(-0.5, 0.5, SIZE)
    return draw[0] + draw[1] * axis[:, None] + draw[2] * axis


def reference(i, draw):
    """One image and its depth, spelled out."""
    color, code, mask, behind, behind_code = make_windows()
    y, x = np.mgrid[:SIZE, :SIZE]
    occluded = (y >= draw["top"]) & (y < draw["bottom"]) & (x >= draw["left"]) & (x < draw["right"])
    shown = mask[i] & ~draw["background_only"] & ~occluded
    image = behind[draw["background"]] / 255 * draw["background_gain"]
    image = np.where(shown[..., None], color[i] / 255 @ draw["color_mix"].T, image)
    other = behind[draw["occluder"]] / 255 * draw["occluder_gain"]
    image = np.where(occluded[..., None], other, image)
    image = np.clip(image * draw["exposure"], 0, 1) ** draw["gamma"]
    image = (image - image.mean()) * draw["contrast"] + image.mean()
    kernel = np.outer([0.25, 0.5, 0.25], [0.25, 0.5, 0.25])[..., None]
    for _ in range(draw["blurs"]):
        image = convolve(image, kernel, mode="nearest")
    start, pixels = draw["noise_start"], SIZE * SIZE
    noise = NOISE[start : start + 3 * pixels].reshape(image.shape)
    image = np.clip(image + noise * draw["color_noise"], 0, 1) * 2 - 1
    measured = behind_code[draw["background"]]
    depth = (measured - 128.0) / 127.0
    if not measured.any():
        depth = plane(draw["background_plane"]) + smooth(draw["background_heights"])
    depth = np.where(shown, (code[i] - 128.0) / 127.0, depth + draw["background_offset"])
    depth = np.where(occluded, plane(draw["occluder_plane"]), depth)
    noise = NOISE[start + 3 * pixels : start + 4 * pixels].reshape(depth.shape)
    depth = np.clip(depth + draw["depth_shift"] + noise * draw["depth_noise"], -1, 1)
    depth = np.where(smooth(draw["holes"]) > draw["hole_level"], 1.0, depth)
    top, bottom, left, right = draw["image"]
    inside = (y >= top) & (y < bottom) & (x >= left) & (x < right)
    return np.where(inside[..., None], image, -1.0), np.where(inside, depth, 1.0)


def test_each_image_is_what_plain_numpy_makes_of_the_same_draws():
    drawn = draws()
    images = composed(drawn)
    assert images.shape == (COUNT, SIZE, SIZE, 4) and images.dtype == np.float32
    for i, draw in enumerate(drawn):
        color, depth = reference(i, draw)
        # The tone curve is a table of 2049 values; a dark pixel under a small gamma is coarsest.
        assert np.abs(images[i, ..., :3] - color).mean() < 1e-3
        np.testing.assert_allclose(images[i, ..., :3], color, atol=0.05)
        wrong = np.abs(images[i, ..., 3] - depth) > 1e-5
        assert wrong.sum() <= 1  # rounding at the edge of a hole


def test_beyond_the_border_a_window_is_what_one_cut_at_the_images_border_is():
    drawn = draws()
    drawn["image"][:2] = [[0, SIZE, 12, SIZE], [0, 20, 0, SIZE]]
    left, below = composed(drawn)[:2]
    rgb, depth = np.full((60, 80, 3), 200, np.uint8), np.full((60, 80), 0.7, np.float32)
    centers = np.array([[3.5, 30.0], [40.0, 55.5]])  # of 32 px: 12 columns, 12 rows lie outside
    windows = Windows(centers, np.full(2, 0.7), np.full(2, float(SIZE)))
    color, code = cut_windows(rgb, depth, windows, 0.1, SIZE)
    for image, seen, measured in zip((left, below), color, code, strict=True):
        outside = seen[..., 0] == 0
        assert outside.sum() == 12 * SIZE
        np.testing.assert_array_equal(image[outside, :3], seen[outside] / 127.5 - 1.0)
        np.testing.assert_array_equal(image[outside, 3], (measured[outside] - 128.0) / 127.0)
        assert (image[~outside, :3] > -1.0).any(axis=-1).mean() > 0.9


def test_threads_and_depth_change_no_colour():
    drawn = draws()
    one = composed(drawn)
    np.testing.assert_array_equal(composed(drawn, threads=3), one)
    np.testing.assert_array_equal(composed(drawn, with_depth=False), one[..., :3])


@pytest.mark.parametrize("seed", [0, 1])
def test_draws_stay_within_their_ranges(seed):
    drawn = draw_composites(np.random.default_rng(seed), 6000, 64, 11, 0.25)
    assert drawn["background_only"].mean() == pytest.approx(0.25, abs=0.03)
    assert drawn["background"].min() == 0 and drawn["background"].max() == 10
    height, width = drawn["bottom"] - drawn["top"], drawn["right"] - drawn["left"]
    assert height.min() >= 0 and width.min() >= 0
    assert max(height.max(), width.max()) <= 0.6 * 64 + 1
    shown = (height > 0) & (width > 0)
    assert 0.1 < shown.mean() < 1 / 3
    rows = (drawn["top"] < 35) & (drawn["bottom"] > 29)
    columns = (drawn["left"] < 35) & (drawn["right"] > 29)
    assert not (shown & rows & columns).any()  # no occluder over the centre
    top, bottom, left, right = drawn["image"].T
    cut_off = (top > 0) | (bottom < 64) | (left > 0) | (right < 64)
    assert 0.07 < cut_off.mean() < 0.13
    assert max(top.max(), left.max()) <= 32 <= min(bottom.min(), right.min())
    assert 0.3 < (top > 0).sum() / ((top > 0) | (bottom < 64)).sum() < 0.7
    grey = drawn["color_mix"].sum(axis=2)  # what a white surface becomes
    assert np.log(grey).std() > 0.25
    assert drawn["gamma"].min() > 0 and drawn["contrast"].min() >= 0.3
    assert drawn["noise_start"].max() + 4 * 64 * 64 <= NOISE_LENGTH
