import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from hlp.patches.sampling import bleed_color, sample_squares


def positions(center, side, resolution):
    """Where a square is sampled, as the docstring says it."""
    return center + ((np.arange(resolution) + 0.5) / resolution - 0.5) * side


def ramp(height=400, width=500):
    y, x = np.mgrid[:height, :width].astype(np.float32)
    return np.stack([x, y], axis=-1)


# 12: enlarged; 24: 1.5 times smaller, not halved; 25: halved once; 200: halved five times
@pytest.mark.parametrize("side", [4.0, 12.0, 24.0, 25.0, 100.0, 200.0])
def test_output_pixels_lie_at_half_pixels_whatever_the_shrink(side):
    center = np.array([251.3, 199.8])
    cut = sample_squares(ramp(), center[None], np.array([side]), 16)[0]
    x = np.broadcast_to(positions(center[0], side, 16), (16, 16))
    y = np.broadcast_to(positions(center[1], side, 16)[:, None], (16, 16))
    # cv2.remap rounds positions to 1/32 of a pixel of the halved image.
    scale = max(1.0, 2 * side / 16 / 1.5)
    np.testing.assert_allclose(cut[..., 0], x, atol=scale / 32)
    np.testing.assert_allclose(cut[..., 1], y, atol=scale / 32)


def test_bilinear_values_equal_scipys_also_beyond_the_border():
    y, x = np.mgrid[:40, :50]
    image = (100 + 60 * np.sin(x / 9.0) + 60 * np.cos(y / 7.0)).astype(np.float32)
    centers = np.array([[20.2, 18.7], [1.4, 36.9], [60.0, 10.0]])
    sides = np.array([11.0, 14.5, 12.0])
    cut = sample_squares(image, centers, sides, 10)
    for i in range(3):
        grid = np.meshgrid(
            positions(centers[i, 1], sides[i], 10), positions(centers[i, 0], sides[i], 10),
            indexing="ij",
        )  # fmt: skip
        padded = np.pad(image, 30)
        expected = map_coordinates(padded, [g + 30 for g in grid], order=1)
        np.testing.assert_allclose(cut[i], expected, atol=8.0)  # 1/32 px at a border of 200 levels
        inside = (grid[0] > 0) & (grid[0] < 39) & (grid[1] > 0) & (grid[1] < 49)
        np.testing.assert_allclose(cut[i][inside], expected[inside], atol=0.5)
    assert not cut[2].any()


def test_shrinking_averages_instead_of_picking_pixels():
    y, x = np.mgrid[:256, :256]
    checkers = ((x + y) % 2 * 255).astype(np.uint8)
    cut = sample_squares(checkers, np.array([[127.5, 127.5]]), np.array([200.0]), 16)
    assert np.abs(cut.astype(int) - 127).max() <= 1


def test_nearest_takes_single_measurements():
    rng = np.random.default_rng(1)
    depth = rng.random((60, 80)).astype(np.float32)
    center, side = np.array([33.37, 28.21]), 41.3
    cut = sample_squares(depth, center[None], np.array([side]), 9, nearest=True)[0]
    rows = np.rint(positions(center[1], side, 9)).astype(int)
    columns = np.rint(positions(center[0], side, 9)).astype(int)
    np.testing.assert_array_equal(cut, depth[np.ix_(rows, columns)])


def test_patches_do_not_depend_on_how_many_are_cut_at_once():
    rng = np.random.default_rng(2)
    image = rng.integers(0, 256, (64, 64, 3)).astype(np.uint8)
    count = 2100  # more rows than one remap addresses
    centers, sides = rng.uniform(5, 60, (count, 2)), rng.uniform(4, 40, count)
    together = sample_squares(image, centers, sides, 8)
    for i in (0, 2047, 2048, 2099):
        alone = sample_squares(image, centers[i : i + 1], sides[i : i + 1], 8)
        np.testing.assert_array_equal(together[i], alone[0])


def test_a_square_far_larger_than_the_image_holds_little_of_it():
    image = np.full((48, 64, 3), 200, np.uint8)
    cut = sample_squares(image, np.array([[32.0, 24.0]]), np.array([40_000.0]), 32)[0]
    assert cut.shape == (32, 32, 3)
    assert (cut[:8] == 0).all()


def test_no_squares_give_no_patches():
    cut = sample_squares(ramp(10, 10), np.zeros((0, 2)), np.zeros(0), 8)
    assert cut.shape == (0, 8, 8, 2)


def test_bleeding_continues_colour_by_the_mean_of_the_object_nearby():
    rng = np.random.default_rng(3)
    mask = np.zeros((30, 30), bool)
    mask[8:20, 10:18] = True
    mask[12, 18] = True
    rgb = np.where(mask[..., None], rng.integers(50, 256, (30, 30, 3)), 0).astype(np.uint8)
    out = bleed_color(rgb, mask)
    np.testing.assert_array_equal(out[mask], rgb[mask])
    for y in range(4, 26):
        for x in range(4, 26):
            near = mask[y - 2 : y + 3, x - 2 : x + 3]
            if mask[y, x]:
                continue
            colors = rgb[y - 2 : y + 3, x - 2 : x + 3][near]
            expected = colors.mean(axis=0) if len(colors) else np.zeros(3)
            np.testing.assert_allclose(out[y, x], expected, atol=1.0)
