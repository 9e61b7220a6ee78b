import numpy as np
import pytest

from hlp.geometry import rotation_distance
from hlp.patches import local_pool
from hlp.patches.local import LocalSettings
from hlp.patches.local_data import degrade_patches
from hlp.patches.local_pool import PairSettings, bake_frame_patches, bake_pairs, cut_view_patches

LOCAL = LocalSettings(16, 1.5, True)
COUNT = 200
MAX_ANGLE = 25.0


@pytest.fixture(scope="module")
def baked(views, model):
    """A pool of pairs, with the views and pixels that its patches were cut at."""
    cuts = []
    cut = local_pool._cut_by_view

    def spy(views, chosen, pixels, size, local, with_color):
        cuts.append((chosen, pixels))
        return cut(views, chosen, pixels, size, local, with_color)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local_pool, "_cut_by_view", spy)
        pairs = PairSettings(COUNT, MAX_ANGLE)
        pool = bake_pairs(views, model.local_size, LOCAL, pairs, np.random.default_rng(0), True)
    return pool, cuts


def seen_at(views, chosen, pixels):
    """Surface points in object coordinates under pixels of views, one by one."""
    points = []
    for view, (x, y) in zip(chosen, pixels, strict=True):
        ray = np.linalg.inv(views.camera_matrix) @ [x, y, 1.0]
        cam = np.append(ray * views.depth[view, y, x], 1.0)
        points.append((np.linalg.inv(views.poses_cam_obj[view]) @ cam)[:3])
    return np.array(points)


def test_both_patches_of_a_pair_show_the_same_surface_point(baked, views):
    pool, ((first, first_pixels), (second, second_pixels)) = baked
    np.testing.assert_allclose(seen_at(views, first, first_pixels), pool.points_obj, atol=1e-6)
    apart = np.linalg.norm(seen_at(views, second, second_pixels) - pool.points_obj, axis=1)
    # At most 5 mm in depth, and half a pixel's diagonal across.
    half_pixel = np.sqrt(0.5) * 0.8 / views.camera_matrix[0, 0]
    assert apart.max() <= np.hypot(0.005, half_pixel) + 0.005
    assert np.median(apart) < 0.002


def test_partners_are_neighbouring_views(baked, views):
    pool, ((first, _), (second, _)) = baked
    rotations = views.poses_cam_obj[:, :3, :3]
    angles = np.rad2deg(rotation_distance(rotations[first], rotations[second]))
    assert angles.max() <= MAX_ANGLE + 1e-6
    assert (first != second).mean() > 0.2
    np.testing.assert_allclose(pool.rotations, rotations[first], atol=1e-6)


def test_patches_lie_in_the_order_of_their_pairs(baked, views, model):
    pool, cuts = baked
    size = model.local_size
    for side, (chosen, pixels) in enumerate(cuts):
        for i in range(0, COUNT, 17):
            alone = cut_view_patches(views, int(chosen[i]), pixels[i : i + 1], size, LOCAL, True)
            np.testing.assert_array_equal(pool.color[i, side], alone.color[0])
            np.testing.assert_allclose(pool.depth[i, side], alone.depth[0], atol=1e-3)  # 16 bits
            np.testing.assert_array_equal(pool.valid[i, side], alone.valid[0])


def test_every_surface_pixel_of_a_view_gives_a_patch(views, model):
    y, x = np.nonzero(views.depth[5] > 0)
    pixels = np.stack([x, y], axis=1)
    cut = cut_view_patches(views, 5, pixels, model.local_size, LOCAL, True)
    np.testing.assert_array_equal(cut.pixels, pixels)
    assert cut.valid[:, 8, 8].mean() > 0.95
    black = (cut.color < 12).all(axis=-1) & cut.valid  # the void bleeds into no patch
    assert black.mean() < 0.01


def test_colour_is_left_out_where_it_is_not_needed(views, model):
    pixels = np.stack(np.nonzero(views.depth[0].T > 0), axis=1)[::40]
    full = cut_view_patches(views, 0, pixels, model.local_size, LOCAL, True)
    bare = cut_view_patches(views, 0, pixels, model.local_size, LOCAL, False)
    assert bare.color.shape == (*full.valid.shape, 0)
    np.testing.assert_array_equal(bare.depth, full.depth)
    seen = [degrade_patches(item, np.arange(len(item)), 0.05, 3) for item in (full, bare)]
    assert seen[1].color.shape == bare.color.shape
    np.testing.assert_array_equal(seen[1].depth, seen[0].depth)
    np.testing.assert_array_equal(seen[1].valid, seen[0].valid)


def test_frames_give_patches_of_every_size_with_enough_depth(room):
    rng = np.random.default_rng(0)
    found = bake_frame_patches([room, room], [0.04, 0.1], 60, LOCAL, rng)
    assert len(found) == 4
    for patches in found:
        assert 20 < len(patches) <= 30
        assert (patches.valid.mean(axis=(1, 2)) >= 0.2).all()


def test_small_frames_give_what_they_have(room):
    (found,) = bake_frame_patches([room], [0.04], 10_000, LOCAL, np.random.default_rng(0))
    assert 2500 < len(found) <= 64 * 48
