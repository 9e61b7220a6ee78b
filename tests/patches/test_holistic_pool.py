import dataclasses

import numpy as np
import pytest

from hlp.geometry import project
from hlp.patches import holistic_pool
from hlp.patches.holistic_pool import (
    BACKGROUND,
    HolisticPoolSettings,
    bake_backgrounds,
    bake_windows,
)

SETTINGS = HolisticPoolSettings(
    per_object=144,
    off_center=0.25,
    wrong_scale=0.2,
    background_share=0.25,
    center_tolerance=0.2,
    off_center_from=0.4,
    scale_jitter=0.0,
    backgrounds=30,
)
RESOLUTION = 24


def bake(views, model, settings=SETTINGS, seed=0, sizes=(0.1, 0.2)):
    rng = np.random.default_rng(seed)
    return bake_windows(views, model, 3, sizes, RESOLUTION, settings, rng)


@pytest.fixture
def cuts(monkeypatch):
    """Centre, depth, side (px) and metric size of every window that is cut."""
    seen = []
    cut = holistic_pool.cut_windows

    def spy(rgb, depth, windows, size, resolution):
        seen.extend(zip(windows.centers, windows.depths, windows.sides, size.ravel(), strict=True))
        return cut(rgb, depth, windows, size, resolution)

    monkeypatch.setattr(holistic_pool, "cut_windows", spy)
    return seen


def only(settings, **changes):
    return dataclasses.replace(settings, off_center=0.0, wrong_scale=0.0, **changes)


def test_labels_and_shares(views, model):
    pool = bake(views, model)
    assert len(pool.labels) == 144
    assert set(pool.labels) == {BACKGROUND, 3}
    assert (pool.labels == BACKGROUND).mean() == pytest.approx(0.45, abs=0.12)
    assert (bake(views, model, only(SETTINGS)).labels == 3).all()


def test_the_same_generator_bakes_the_same_pool(views, model):
    first, second, other = bake(views, model), bake(views, model), bake(views, model, seed=1)
    for name in ("color", "depth", "mask", "labels"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert (first.color != other.color).any()


def test_centred_windows_show_the_object_at_their_depth(views, model):
    pool = bake(views, model, only(SETTINGS))
    middle = (slice(None), RESOLUTION // 2, RESOLUTION // 2)
    assert pool.mask[middle].mean() > 0.95
    # The side follows from the surface depth at the centre: depth there is coded as 128.
    assert (np.abs(pool.depth[middle][pool.mask[middle]].astype(int) - 128) < 16).mean() > 0.9
    np.testing.assert_array_equal(pool.mask, pool.depth < 255)


def test_badly_centred_windows_lie_away_from_the_centroid(views, model, cuts):
    settings = dataclasses.replace(SETTINGS, off_center=0.5, wrong_scale=0.0)
    pool = bake(views, model, settings)
    middle = project(views.poses_cam_obj[0, :3, :3] @ model.centroid
                     + views.poses_cam_obj[0, :3, 3], views.camera_matrix)  # fmt: skip
    depths = [float(np.median(d[d > 0])) for d in views.depth]
    focal = views.camera_matrix[0, 0]
    for i, (center, z, side, size) in enumerate(cuts):
        typical = depths[i // 4]  # 144 windows of 36 views
        shift = np.hypot(*(center - middle)) * typical / focal / model.holistic_size
        assert (shift < 0.2) if pool.labels[i] == 3 else (shift > 0.4)
        assert side == pytest.approx(focal * size / z)
        assert size == pytest.approx(model.holistic_size)
        assert 0.8 * typical < z < 1.3 * typical


def test_wrongly_scaled_windows_are_background_and_of_another_size(views, model, cuts):
    settings = dataclasses.replace(SETTINGS, off_center=0.0, wrong_scale=0.5)
    pool = bake(views, model, settings, sizes=(0.1, 0.11, 0.2))
    ratio = np.array([size for *_, size in cuts]) / model.holistic_size
    wrong = pool.labels == BACKGROUND
    assert 0.3 < wrong.mean() < 0.7
    np.testing.assert_allclose(ratio[~wrong], 1.0)
    assert (np.abs(np.log(ratio[wrong])) > np.log(1.3)).all()
    assert {0.55, 1.8, 2.0} <= set(np.round(ratio[wrong], 2))


def test_scale_jitter_is_bounded(views, model, cuts):
    bake(views, model, only(SETTINGS, scale_jitter=0.08))
    ratio = np.array([size for *_, size in cuts]) / model.holistic_size
    assert ratio.min() >= 1 / 1.08 and ratio.max() <= 1.08
    assert ratio.std() > 0.02


def test_backgrounds_are_photographs_and_as_many_windows_of_each_group_of_frames(room):
    crops = np.random.default_rng(0).integers(0, 256, (7, 24, 24, 3)).astype(np.uint8)
    red = dataclasses.replace(room, rgb=np.broadcast_to([255, 0, 0], room.rgb.shape).astype("u1"))
    blind = dataclasses.replace(room, depth=np.zeros_like(room.depth))
    groups, rng = [[red], [], [room] * 3, [blind]], np.random.default_rng(0)
    pool = bake_backgrounds(crops, groups, [0.1, 0.2], 24, 30, rng)
    np.testing.assert_array_equal(pool.color[:7], crops)
    assert not pool.depth[:7].any()  # 0: no depth was measured
    is_red = ~pool.color[7:, ..., 1:].any(axis=(1, 2, 3))
    assert len(is_red) == 60 and is_red[:30].all() and not is_red[30:].any()
    assert (pool.depth[7:] > 0).all()
    assert (np.abs(pool.depth[7:, 12, 12].astype(int) - 128) < 10).mean() > 0.7
    many = bake_backgrounds(crops, [[room] * 5], [0.1, 0.2], 24, 3, rng)
    assert len(many.color) == 7 + 3  # of more frames than windows, each gives one or none


@pytest.mark.parametrize(("objects", "share"), [(1, 1 / 2), (2, 1 / 3), (3, 1 / 4), (15, 1 / 4)])
def test_background_is_at_least_as_frequent_as_an_object(objects, share):
    assert SETTINGS.background_share_for(objects) == pytest.approx(share)


@pytest.mark.parametrize("objects", [1, 4, 15])
def test_the_odds_of_an_object_are_those_of_its_windows(views, model, objects):
    labels = bake(views, model, dataclasses.replace(SETTINGS, per_object=3000)).labels
    shown = 1 - SETTINGS.background_share_for(objects)
    positive = shown * (labels == 3).mean()
    assert SETTINGS.object_odds(objects) == pytest.approx(
        positive / objects / (1 - positive), rel=0.1
    )


def test_a_colourless_object_has_another_colour_in_every_window_and_the_same_shading(views, model):
    colored = bake(views, model)
    colourless = dataclasses.replace(model.mesh, colored=False)
    pool = bake(views, dataclasses.replace(model, mesh=colourless))
    for name in ("depth", "mask", "labels"):
        np.testing.assert_array_equal(getattr(pool, name), getattr(colored, name))
    means = pool.color.mean(axis=(1, 2))
    assert means.std(axis=0).min() > 30 and means.mean(axis=1).min() < 60
    hue = means - means.mean(axis=1, keepdims=True)
    assert np.abs(hue).max(axis=1).std() > 5
    for before, after in zip(colored.color[:20], pool.color[:20], strict=True):
        unclipped = (after < 255).all(axis=2)
        if before[unclipped].std() > 10 and after[unclipped].std() > 10:
            for channel in range(3):
                pair = before[unclipped][:, channel], after[unclipped][:, channel]
                assert np.corrcoef(*pair)[0, 1] > 0.97
