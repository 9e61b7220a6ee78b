import numpy as np
import pytest

from hlp.patches.holistic import center_depths, cut_windows, depth_code, metric_windows, pixel_grid

CAMERA = np.array([[570.0, 0.0, 320.0], [0.0, 574.0, 240.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(("shape", "step"), [((40, 56), 8), ((33, 47), 8), ((20, 30), 1)])
def test_grid_is_even_and_within_the_image(shape, step):
    expected = [
        (x, y) for y in range(step // 2, shape[0], step) for x in range(step // 2, shape[1], step)
    ]
    np.testing.assert_array_equal(pixel_grid(shape, step), expected)


def test_center_depth_is_the_median_of_the_depths_around():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 1.5, (24, 30)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.4] = 0.0
    depth[0:6, 0:6] = 0.0
    depth[20, 20] = np.nan
    pixels = np.stack(np.meshgrid(np.arange(30), np.arange(24)), axis=-1).reshape(-1, 2)
    found = center_depths(depth, pixels)
    for (x, y), value in zip(pixels, found, strict=True):
        near = depth[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        near = np.sort(near[near > 0])  # NaN is no depth
        expected = near[(len(near) - 1) // 2] if len(near) else 0.0  # a measured one: the lower
        assert value == np.float32(expected)


def test_window_sides_follow_equation_1_and_missing_depth_gives_no_window():
    depth = np.zeros((48, 64), np.float32)
    depth[:, :32] = 0.8
    depth[:24, 32:] = 1.6
    found = metric_windows(depth, CAMERA, 0.2, 8)
    at = {tuple(center): side for center, side in zip(found.centers, found.sides, strict=True)}
    assert at[(4.0, 4.0)] == pytest.approx(572.0 * 0.2 / 0.8)
    assert at[(60.0, 4.0)] == pytest.approx(572.0 * 0.2 / 1.6)
    assert (60.0, 44.0) not in at
    assert len(at) == 4 * 6 + 4 * 3
    np.testing.assert_allclose(found.sides * found.depths, 572.0 * 0.2, rtol=1e-6)


def test_depth_code_counts_in_steps_of_the_metric_size():
    center = np.array([1.0], np.float32)
    meters = np.array([[[1.0, 1.1, 0.9, 1.2, 5.0, 0.1, 0.0]]], np.float32)
    code = depth_code(meters, center, 0.2)
    assert code.dtype == np.uint8
    # centre 128; ±half a size ±63.5, rounded; clamped to 1 … 254; missing 255
    np.testing.assert_array_equal(code[0, 0], [128, 192, 64, 254, 254, 1, 255])


def test_cut_windows_holds_the_colour_and_the_coded_depth_of_each(room):
    windows = metric_windows(room.depth, room.camera_matrix, 0.1, 16)
    color, code = cut_windows(room.rgb, room.depth, windows, 0.1, 12)
    assert color.shape == (len(windows.sides), 12, 12, 3)
    x, y = windows.centers.astype(int).T
    middle = color[:, 5:7, 5:7].astype(float).mean(axis=(1, 2))
    inside = (x > 10) & (x < 118) & (y > 10) & (y < 86)
    np.testing.assert_allclose(middle[inside], room.rgb[y, x][inside], atol=1.5)
    measured = room.depth[y, x] > 0
    assert (np.abs(code[measured & inside][:, 6, 6].astype(int) - 128) <= 4).all()
    assert (code == 255).any()  # the hole
