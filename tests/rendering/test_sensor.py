from dataclasses import replace

import numpy as np
import pytest

from hlp.rendering.sensor import KINECT, kinect, noisy_depth, noisy_rgb, projector_shadow

FOCAL = 572.0
IDEAL = kinect(0.0)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def wall(distance: float, count: int = 1) -> np.ndarray:
    return np.full((count, 120, 160), distance, dtype=np.float32)


@pytest.mark.parametrize("z", [0.6, 1.0, 2.0, 3.0])
def test_axial_noise_grows_with_the_square_of_depth(z: float) -> None:
    noise_only = replace(IDEAL, disparity_noise=KINECT.disparity_noise)
    read = noisy_depth(wall(z, 8), FOCAL, rng(), noise_only)
    assert read.std() == pytest.approx(0.0015 * z * z, rel=0.06)
    assert read.mean() == pytest.approx(z, abs=0.0003 * z * z)


@pytest.mark.parametrize("z", [0.8, 1.0, 2.0])
def test_quantisation_steps_are_those_of_disparity(z: float) -> None:
    steps_only = replace(IDEAL, disparity_step=KINECT.disparity_step)
    ramp = np.linspace(0.97 * z, 1.03 * z, 120 * 160, dtype=np.float32).reshape(1, 120, 160)
    levels = np.unique(noisy_depth(ramp, FOCAL, rng(), steps_only))
    step = np.median(np.diff(levels))
    assert step == pytest.approx(z * z * 0.125 / (FOCAL * 0.075), rel=0.05)
    assert step == pytest.approx(0.0029 * z * z, rel=0.08)


def test_kinect_reads_a_wall_with_the_sum_of_both_and_in_whole_millimetres() -> None:
    read = noisy_depth(wall(1.003, 8), FOCAL, rng(), KINECT)
    seen = read[read > 0]
    assert 0.0013 < seen.std() < 0.0022
    np.testing.assert_allclose(seen * 1000, np.rint(seen * 1000), atol=1e-3)
    assert 0 < (read == 0).mean() < 0.01


def test_holes_have_the_rate_and_size_asked_for() -> None:
    holes_only = replace(IDEAL, hole_rate=1e-4)
    read = noisy_depth(wall(1.0, 200), FOCAL, rng(), holes_only)
    # Discs of radius 1…4 px hold 5, 13, 29 and 49 pixels: 24 on average.
    assert (read == 0).mean() == pytest.approx(24e-4, rel=0.15)


def test_shadow_lies_left_of_the_nearer_surface_and_has_the_parallax_width() -> None:
    depth = wall(1.2)
    depth[:, 30:90, 80:110] = 0.8
    shadow = projector_shadow(depth, FOCAL, 0.075)[0]
    width = FOCAL * 0.075 * (1 / 0.8 - 1 / 1.2)
    rows = shadow[30:90].sum(axis=1)
    np.testing.assert_allclose(rows, width, atol=1.0)
    assert shadow[60, 79]
    assert not shadow[:, 80:].any()
    assert not shadow[:30].any()
    read = noisy_depth(depth, FOCAL, rng(), replace(IDEAL, shadow=True))[0]
    np.testing.assert_array_equal(read == 0, shadow)


def test_shadow_agrees_with_tracing_rays_to_the_projector() -> None:
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


def test_grazing_surfaces_are_lost_and_frontal_ones_kept() -> None:
    grazing_only = replace(IDEAL, grazing_deg=KINECT.grazing_deg)
    y = (np.arange(120) - 60)[:, None] / FOCAL

    def lost(degrees: float) -> float:
        # A plane tilted about the x axis: z (1 − y tan θ) = 1 gives the angle θ at the middle.
        plane = 1.0 / (1.0 - y * np.tan(np.radians(degrees)))
        depth = np.broadcast_to(plane, (120, 160)).astype(np.float32)[None, 50:70]
        return float((noisy_depth(depth, FOCAL, rng(), grazing_only) == 0).mean())

    assert lost(0) == lost(60) == 0.0
    assert 0.1 < lost(82) < 0.9
    assert lost(86) > 0.95


def test_jitter_moves_edges_by_a_pixel_and_nothing_else() -> None:
    jitter_only = replace(IDEAL, edge_jitter=1)
    depth = wall(1.5)
    depth[:, :, 80:] = 0.8
    read = noisy_depth(depth, FOCAL, rng(), jitter_only)
    changed = (read != depth)[0]
    assert set(np.nonzero(changed.any(axis=0))[0]) == {79, 80}
    assert 0.2 < changed[:, 79:81].mean() < 0.5
    assert set(np.unique(read)) == set(np.unique(depth))


def test_missing_and_far_depth_stay_missing() -> None:
    depth = wall(1.0)
    depth[:, :40] = 0.0
    depth[:, 40:80] = 9.0
    read = noisy_depth(depth, FOCAL, rng(), KINECT)
    assert (read[:, :79] == 0).all()
    assert np.isfinite(read).all()


def test_ideal_sensor_changes_nothing() -> None:
    depth = np.abs(rng().normal(1.0, 0.2, (2, 40, 50))).astype(np.float32)
    np.testing.assert_array_equal(noisy_depth(depth, FOCAL, rng(), IDEAL), depth)
    rgb = rng().integers(0, 256, (2, 40, 50, 3), dtype=np.uint8)
    np.testing.assert_array_equal(noisy_rgb(rgb, rng(), IDEAL), rgb)
    with pytest.raises(ValueError, match="0 or more"):
        kinect(-1.0)


def test_same_generator_same_reading_for_images_and_batches() -> None:
    depth = wall(1.0)
    depth[:, 40:80, 60:100] = 0.8
    one = noisy_depth(depth[0], FOCAL, rng(3), KINECT)
    np.testing.assert_array_equal(one, noisy_depth(depth, FOCAL, rng(3), KINECT)[0])
    assert not np.array_equal(one, noisy_depth(depth[0], FOCAL, rng(4), KINECT))
    batch = noisy_depth(np.repeat(depth, 5, axis=0), FOCAL, rng(3), KINECT)
    assert batch.shape == (5, 120, 160)
    assert not np.array_equal(batch[0], batch[1])
    assert (depth[0, 40:80, 60:100] == np.float32(0.8)).all()


def test_color_noise_gain_and_blur() -> None:
    grey = np.full((64, 60, 60, 3), 120, dtype=np.uint8)
    noise_only = replace(IDEAL, rgb_noise=4.0)
    assert noisy_rgb(grey, rng(), noise_only).astype(float).std() == pytest.approx(4.0, rel=0.03)
    gains = replace(IDEAL, exposure=0.15, white_balance=0.05)
    means = np.log(noisy_rgb(grey, rng(), gains).astype(float).mean(axis=(1, 2)) / 120)
    assert means.mean(axis=1).std() == pytest.approx(0.15, rel=0.3)
    assert (means - means.mean(axis=1, keepdims=True)).std() == pytest.approx(0.041, rel=0.3)
    step = np.zeros((1, 20, 20, 3), dtype=np.uint8)
    step[:, :, 10:] = 200
    blurred = noisy_rgb(step, rng(), replace(IDEAL, rgb_blur=1.0))
    assert 20 < blurred[0, 10, 9, 0] < 100 < blurred[0, 10, 10, 0] < 180
