import numpy as np
import pytest

from hlp.patches.backgrounds import procedural_backgrounds


@pytest.fixture(scope="module")
def pictures():
    return procedural_backgrounds(200, 64, np.random.default_rng(0))


def test_they_differ_in_brightness_colour_and_texture(pictures):
    values = pictures.astype(float)
    brightness = values.mean(axis=(1, 2, 3))
    assert brightness.min() < 50 and brightness.max() > 170 and brightness.std() > 30
    saturation = np.ptp(values.mean(axis=(1, 2)), axis=-1)
    assert np.percentile(saturation, 10) < 12 and np.percentile(saturation, 90) > 40
    texture = values.mean(axis=-1).std(axis=(1, 2))
    assert texture.min() > 0 and np.percentile(texture, 90) > 2 * np.percentile(texture, 10)


def test_neighbouring_pixels_are_alike_as_in_photographs(pictures):
    grey = pictures.astype(float).mean(axis=-1)
    near = np.abs(np.diff(grey, axis=2)).mean(axis=(1, 2))
    far = np.abs(grey[:, :, 32:] - grey[:, :, :32]).mean(axis=(1, 2))
    assert np.median(near / far) < 0.5


def test_most_hold_hard_edges(pictures):
    grey = pictures.astype(float).mean(axis=-1)
    steps = np.abs(np.diff(grey, axis=2)).reshape(len(grey), -1).max(axis=1)
    assert (steps > 40).mean() > 0.5


def test_the_generator_decides():
    first, again, other = (
        procedural_backgrounds(6, 32, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


@pytest.mark.parametrize("size", [1, 8, 33, 128])
def test_any_size_works(size):
    assert procedural_backgrounds(3, size, np.random.default_rng(0)).shape == (3, size, size, 3)
    assert procedural_backgrounds(0, size, np.random.default_rng(0)).shape == (0, size, size, 3)
