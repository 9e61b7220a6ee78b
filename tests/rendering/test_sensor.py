import numpy as np
import pytest

from hlp.rendering import sensor
from hlp.rendering.sensor import Kinect, noisy_depth, noisy_rgb, projector_shadow

FOCAL = 572.0


def rng(seed=0):
    return np.random.default_rng(seed)


def wall(distance, count=1):
    return np.full((count, 120, 160), distance, dtype=np.float32)


@pytest.mark.parametrize("z", [0.6, 1.0, 2.0, 3.0])
def test_axial_noise_and_quantisation_grow_with_the_square_of_depth(z, monkeypatch):
    monkeypatch.setattr(sensor, "_DEPTH_UNIT", 1e-6)
    ramp = np.linspace(0.97 * z, 1.03 * z, 120 * 160, dtype=np.float32).reshape(1, 120, 160)
    step = np.median(np.diff(np.unique(sensor._measured(ramp, FOCAL, rng(), 0.0))))
    assert step == pytest.approx(z * z * 0.125 / (FOCAL * 0.075), rel=0.05)
    assert step == pytest.approx(0.0029 * z * z, rel=0.08)
    monkeypatch.setattr(sensor, "_DISPARITY_STEP", 1e-6)
    read = sensor._measured(wall(z, 8), FOCAL, rng(), 0.064)
    assert read.std() == pytest.approx(0.0015 * z * z, rel=0.06)
    assert read.mean() == pytest.approx(z, abs=0.0003 * z * z)


def test_kinect_reads_a_wall_with_the_sum_of_both_and_in_whole_millimetres():
    read = noisy_depth(wall(1.003, 8), FOCAL, rng(), Kinect())
    seen = read[read > 0]
    assert 0.0013 < seen.std() < 0.0022
    np.testing.assert_allclose(seen * 1000, np.rint(seen * 1000), atol=1e-3)
    assert 0 < (read == 0).mean() < 0.01
    # Discs of radius 1…4 px hold 5, 13, 29 and 49 pixels: 24 on average.
    noisy = noisy_depth(wall(1.0, 200), FOCAL, rng(), Kinect(5.0))
    assert (noisy == 0).mean() == pytest.approx(24e-4, rel=0.15)


def test_nothing_is_read_in_the_shadow_left_of_a_nearer_surface():
    depth = wall(1.2)
    depth[:, 30:90, 80:110] = 0.8
    shadow = projector_shadow(depth, FOCAL, 0.075)[0]
    assert shadow[60, 79] and not shadow[:, 80:].any()
    read = noisy_depth(depth, FOCAL, rng(), Kinect(edge_jitter=0))[0]
    assert (read[shadow] == 0).all()


def test_shadow_agrees_with_tracing_rays_to_the_projector():
    columns = np.arange(160)
    near = 0.7 + 0.1 * np.sin(columns / 9.0)
    row = np.where((columns > 60) & (columns < 100), near, 1.5).astype(np.float32)
    points = np.column_stack([(columns - 80) / FOCAL * row, row])
    # A point is lit if no segment between neighbouring points crosses its ray to the projector.
    seen_from = points - [0.075, 0.0]
    slope = seen_from[:, 0] / seen_from[:, 1]
    lit = np.array([not (slope[i + 1 :] < slope[i]).any() for i in range(160)])
    shadow = projector_shadow(row[None, None], FOCAL, 0.075)[0, 0]
    assert (shadow == ~lit).mean() > 0.97
    assert shadow.sum() > 20


def test_grazing_surfaces_are_lost_and_frontal_ones_kept():
    y = (np.arange(120) - 60)[:, None] / FOCAL

    def lost(degrees):
        # A plane tilted about the x axis: z (1 − y tan θ) = 1 gives the angle θ at the middle.
        plane = 1.0 / (1.0 - y * np.tan(np.radians(degrees)))
        depth = np.broadcast_to(plane, (120, 160)).astype(np.float32)[None, 50:70]
        return float((noisy_depth(depth, FOCAL, rng(), Kinect(1e-6)) == 0).mean())

    assert lost(0) == lost(60) == 0.0
    assert 0.1 < lost(82) < 0.9
    assert lost(86) > 0.95


def test_jitter_moves_edges_by_a_pixel_and_nothing_else():
    depth = wall(1.5)
    depth[:, :, 80:] = 0.8
    read = sensor._jittered(depth, sensor._jumps(depth), rng(), 1)
    changed = (read != depth)[0]
    assert set(np.nonzero(changed.any(axis=0))[0]) == {79, 80}
    assert 0.2 < changed[:, 79:81].mean() < 0.5
    assert set(np.unique(read)) == set(np.unique(depth))


def test_missing_and_far_depth_stay_missing_and_a_quarter_of_the_edges_is_lost():
    depth = wall(1.0)
    depth[:, :40] = 0.0
    depth[:, 40:80] = 9.0
    depth[:, 80:, 120:] = 1.5  # farther on the right: no shadow
    read = noisy_depth(depth, FOCAL, rng(), Kinect(edge_jitter=0))
    assert (read[:, :80] == 0).all()
    assert np.isfinite(read).all()
    assert 0.1 < (read[:, 81:, 119:121] == 0).mean() < 0.45


def test_ideal_sensor_changes_nothing():
    depth = np.abs(rng().normal(1.0, 0.2, (2, 40, 50))).astype(np.float32)
    np.testing.assert_array_equal(noisy_depth(depth, FOCAL, rng(), Kinect(0.0)), depth)
    rgb = rng().integers(0, 256, (2, 40, 50, 3), dtype=np.uint8)
    np.testing.assert_array_equal(noisy_rgb(rgb, rng(), Kinect(0.0)), rgb)


def test_same_generator_same_reading_for_images_and_batches():
    depth = wall(1.0)
    depth[:, 40:80, 60:100] = 0.8
    one = noisy_depth(depth[0], FOCAL, rng(3), Kinect())
    np.testing.assert_array_equal(one, noisy_depth(depth, FOCAL, rng(3), Kinect())[0])
    assert not np.array_equal(one, noisy_depth(depth[0], FOCAL, rng(4), Kinect()))
    batch = noisy_depth(np.repeat(depth, 5, axis=0), FOCAL, rng(3), Kinect())
    assert batch.shape == (5, 120, 160)
    assert not np.array_equal(batch[0], batch[1])
    assert (depth[0, 40:80, 60:100] == np.float32(0.8)).all()


def test_color_noise_gain_and_blur():
    grey = np.full((64, 60, 60, 3), 120, dtype=np.uint8)
    read = noisy_rgb(grey, rng(), Kinect()).astype(float)
    within = (read - read.mean(axis=(1, 2), keepdims=True)).std()
    assert within == pytest.approx(3.0, rel=0.03)
    means = np.log(read.mean(axis=(1, 2)) / 120)
    assert means.mean(axis=1).std() == pytest.approx(0.15, rel=0.3)
    assert (means - means.mean(axis=1, keepdims=True)).std() == pytest.approx(0.041, rel=0.3)
    step = np.zeros((1, 20, 20, 3), dtype=np.uint8)
    step[:, :, 10:] = 200
    blurred = noisy_rgb(step, rng(), Kinect(1e-6))
    assert 5 < blurred[0, 10, 9, 0] < 100 < blurred[0, 10, 10, 0] < 195
