import numpy as np
import pytest

from hlp.patches.holistic import HolisticSettings, Windows, cut_windows
from hlp.patches.window_images import WindowImages
from hlp.threads import ThreadTeam

RGBD = HolisticSettings(16, "rgbd")


def reference(rgb, depth, windows, size, settings):
    """The images that training's own functions make."""
    color, code = cut_windows(rgb, depth, windows, size, settings.resolution)
    return color if settings.channels == "rgb" else np.concatenate([color, code[..., None]], -1)


def pictures(shape=(120, 160)):
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (*shape, 3)).astype(np.uint8)
    depth = rng.uniform(0.7, 1.3, shape).astype(np.float32)
    depth[rng.random(shape) < 0.2] = 0.0
    depth[3, 4] = np.nan
    return rgb, depth


def random_windows(rng, count, low, high):
    centers = rng.uniform(-20, 180, (count, 2))  # also beyond the image
    return Windows(
        centers, rng.uniform(0.8, 1.2, count).astype(np.float32), rng.uniform(low, high, count)
    )


def assert_same(found, expected, levels_off):
    """Equal, but for a share of the colours that is one of 255 levels off."""
    assert found.dtype == np.uint8 and found.flags.c_contiguous
    assert found.shape == expected.shape
    np.testing.assert_array_equal(found[..., 3:], expected[..., 3:])  # depth: no interpolation
    off = np.abs(found[..., :3].astype(int) - expected[..., :3])
    assert off.max() <= 1
    assert (found != expected).mean() <= levels_off


# Resolution 16: enlarged; not halved; halved once; halved often, far larger than the image
@pytest.mark.parametrize(("low", "high"), [(3, 15), (16, 24), (25, 48), (60, 900)])
@pytest.mark.parametrize("channels", ["rgb", "rgbd"])
def test_images_are_those_that_training_makes(low, high, channels):
    rgb, depth = pictures()
    windows = random_windows(np.random.default_rng(low), 60, low, high)
    settings = HolisticSettings(16, channels)
    found = WindowImages(rgb, depth, settings, ThreadTeam(1)).cut(windows, 0.15)
    assert found.shape[3] == len(channels)
    assert_same(found, reference(rgb, depth, windows, 0.15, settings), 1e-3)


def test_threads_and_chunks_change_nothing():
    rgb, depth = pictures()
    windows = random_windows(np.random.default_rng(5), 37, 5, 70)
    together = WindowImages(rgb, depth, RGBD, ThreadTeam(1)).cut(windows, 0.15)
    shared = WindowImages(rgb, depth, RGBD, ThreadTeam(3))
    np.testing.assert_array_equal(shared.cut(windows, 0.15), together)
    some = shared.cut(windows.at(slice(11, 20)), 0.15)
    np.testing.assert_array_equal(some, together[11:20])


def test_no_windows_have_no_images():
    rgb, depth = pictures()
    nothing = random_windows(np.random.default_rng(0), 0, 5, 6)
    assert WindowImages(rgb, depth, RGBD, ThreadTeam(2)).cut(nothing, 0.15).shape == (0, 16, 16, 4)
