import numpy as np
import pytest

from hlp.patches.local import LocalSettings, cut_local_patches, plane_deviations, surface_pixels

CAMERA = np.array([[200.0, 0.0, 50.0], [0.0, 204.0, 40.0], [0.0, 0.0, 1.0]])
MASKED = LocalSettings(16, 1.0, True)
CLAMPED = LocalSettings(16, 1.0, False)
SIZE = 0.1  # m


@pytest.fixture
def scene():
    """A step: the left half stands 0.2 m before the right one, with a hole below."""
    rng = np.random.default_rng(0)
    depth = np.full((80, 100), 1.0, np.float32)
    depth[:, :50] = 0.8
    depth += rng.uniform(0, 0.03, depth.shape).astype(np.float32)
    depth[60:, :] = 0.0
    rgb = rng.integers(0, 256, (80, 100, 3)).astype(np.uint8)
    return rgb, depth


def reference(depth, pixel, z, resolution):
    """Depth of one patch pixel by pixel, from the docstring: along its ray, clamped to ±1."""
    center = np.linalg.inv(CAMERA) @ [*pixel, 1.0]
    side = 202.0 * SIZE / z
    out = np.ones((resolution, resolution))
    valid = np.zeros((resolution, resolution), bool)
    for i in range(resolution):
        for j in range(resolution):
            place = pixel + ((np.array([j, i]) + 0.5) / resolution - 0.5) * side
            x, y = np.rint(place).astype(int)
            if not (0 <= x < depth.shape[1] and 0 <= y < depth.shape[0]) or depth[y, x] <= 0:
                continue
            point = depth[y, x] * (np.linalg.inv(CAMERA) @ [*place, 1.0])
            relative = (point @ center - z * center @ center) / np.linalg.norm(center) / (SIZE / 2)
            valid[i, j] = abs(relative) <= 1
            out[i, j] = np.clip(relative, -1, 1)
    return out, valid


@pytest.mark.parametrize("settings", [MASKED, CLAMPED])
def test_depth_is_relative_to_the_centre_clamped_and_masked(scene, settings):
    rgb, depth = scene
    pixels = np.array([[46, 30], [54, 31], [20, 55], [3, 4]])
    cut = cut_local_patches(rgb, depth, CAMERA, pixels, SIZE, settings, 0.0)
    assert len(cut) == 4
    partial = 0
    for i, pixel in enumerate(pixels):
        z = np.sort(depth[pixel[1] - 1 : pixel[1] + 2, pixel[0] - 1 : pixel[0] + 2].ravel())[4]
        expected, valid = reference(depth, pixel, z, 16)
        if settings.mask_beyond_clamp:
            expected[~valid] = 1.0
            assert (cut.color[i][~valid] == 128).all()
        np.testing.assert_array_equal(cut.valid[i], valid)
        np.testing.assert_allclose(cut.depth[i], expected, atol=1e-5)
        partial += not valid.all()
        ray = np.linalg.inv(CAMERA) @ [*pixel, 1.0]
        np.testing.assert_allclose(cut.points_cam[i], ray * z, rtol=1e-6)
    assert partial >= 2
    np.testing.assert_array_equal(cut.pixels, pixels)


def test_clamping_alone_keeps_the_colour_beyond(scene):
    rgb, depth = scene
    pixels = np.array([[46, 30]])
    masked = cut_local_patches(rgb, depth, CAMERA, pixels, SIZE, MASKED, 0.0)
    clamped = cut_local_patches(rgb, depth, CAMERA, pixels, SIZE, CLAMPED, 0.0)
    inside = masked.valid[0]
    np.testing.assert_array_equal(masked.color[0][inside], clamped.color[0][inside])
    assert clamped.color[0][~inside].std() > 20


def test_patches_without_depth_or_with_too_little_of_it_are_left_out(scene):
    rgb, depth = scene
    pixels = np.array([[20, 30], [20, 75], [20, 59]])  # full, in the hole, at its border
    cut = cut_local_patches(rgb, depth, CAMERA, pixels, SIZE, MASKED, 0.0)
    np.testing.assert_array_equal(cut.pixels, [[20, 30], [20, 59]])
    share = cut.valid.mean(axis=(1, 2))
    assert share[0] == 1.0 and 0.4 < share[1] < 0.7
    cut = cut_local_patches(rgb, depth, CAMERA, pixels, SIZE, MASKED, 0.8)
    np.testing.assert_array_equal(cut.pixels, [[20, 30]])


def test_no_pixels_give_no_patches(scene):
    cut = cut_local_patches(*scene, CAMERA, np.zeros((0, 2), int), SIZE, MASKED, 0.2)
    assert len(cut) == 0 and cut.color.shape == (0, 16, 16, 3)


def test_surface_pixels_are_drawn_from_the_surface_without_repetition():
    depth = np.zeros((20, 30), np.float32)
    depth[5:9, 10:16] = 0.7
    drawn = surface_pixels(depth, 10, np.random.default_rng(0))
    assert len({tuple(pixel) for pixel in drawn}) == 10
    assert (depth[drawn[:, 1], drawn[:, 0]] > 0).all()
    assert len(surface_pixels(depth, 100, np.random.default_rng(0))) == 24
    again = surface_pixels(depth, 10, np.random.default_rng(0))
    np.testing.assert_array_equal(again, drawn)
    assert (surface_pixels(depth, 10, np.random.default_rng(1)) != drawn).any()


def test_the_deviation_is_the_distance_from_the_best_plane():
    rng = np.random.default_rng(0)
    axis = np.linspace(-1, 1, 16)
    plane = 0.3 + 0.2 * axis[:, None] - 0.4 * axis
    depth = np.stack([plane, plane + rng.normal(0, 0.1, (16, 16)), rng.uniform(-1, 1, (16, 16))])
    design = np.stack([np.ones(256), *(g.ravel() for g in np.meshgrid(axis, axis))], axis=1)
    for patch, deviation in zip(depth, plane_deviations(depth), strict=True):
        fitted = design @ np.linalg.lstsq(design, patch.ravel())[0]
        assert deviation == pytest.approx(np.sqrt(np.mean((patch.ravel() - fitted) ** 2)), abs=1e-7)


def test_flat_patches_are_left_out(scene):
    rgb, depth = scene
    depth = np.where(depth > 0, np.where(np.arange(100) < 50, 0.8, 0.84), 0.0).astype(np.float32)
    pixels = np.array([[50, 30], [20, 30], [80, 25]])  # on the step, and on its flat sides
    every = cut_local_patches(rgb, depth, CAMERA, pixels, SIZE, MASKED, 0.2)
    assert len(every) == 3
    stepped = cut_local_patches(
        rgb, depth, CAMERA, pixels, SIZE, MASKED, 0.2, min_plane_deviation=0.1
    )
    np.testing.assert_array_equal(stepped.pixels, [[50, 30]])
    np.testing.assert_array_equal(stepped.depth[0], every.depth[0])


def test_patches_have_the_objects_own_size_or_one_for_all():
    own = LocalSettings(size_scale=1.0)
    assert [own.side_of(size) for size in (0.03, 0.08)] == [0.03, 0.08]
    same = LocalSettings(size_mm=45.0, size_scale=1.0)
    assert [same.side_of(size) for size in (0.03, 0.08)] == [0.045, 0.045]
    assert LocalSettings(size_scale=1.5).side_of(0.04) == 0.04 * 1.5
