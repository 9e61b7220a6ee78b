"""How well a pose fits: known images, and the synthetic scene at right and wrong poses."""

import numpy as np
import pytest
import trimesh
from numpy.lib.stride_tricks import sliding_window_view

from hlp.geometry import rigid
from hlp.refinement.pose_fit import depth_correlation, measure_fit, slope_correlation
from hlp.refinement.verification import VerificationSettings, Verifier, observe
from hlp.rendering.rasterizer import render_depth
from refinement_scene import CAMERA, colorless, disturbed, model_of

SETTINGS = VerificationSettings()


def bumps(seed):
    """A smooth surface (m) at about 1 m."""
    y, x = np.mgrid[0.0:80.0, 0.0:100.0]
    a, b, c = np.random.default_rng(seed).uniform(0.05, 0.12, 3)
    return np.float32(1.0 + 0.01 * (np.sin(a * x + seed) + np.cos(b * y) + np.sin(c * (x + y))))


def test_depth_correlation_is_that_of_what_planes_leave():
    first, second = bumps(1), bumps(2)
    among = np.random.default_rng(0).random(first.shape) < 0.3
    y, x = np.nonzero(among)
    plane = np.column_stack([x, y, np.ones(len(x))])
    left = [
        item[among] - plane @ np.linalg.lstsq(plane, item[among], rcond=None)[0]
        for item in (first, second)
    ]
    expected = np.corrcoef(*left)[0, 1]
    found, deviation = depth_correlation(first, second, among)
    assert found == pytest.approx(expected, abs=1e-9)
    assert deviation == pytest.approx(left[0].std(), abs=1e-9)


def test_slopes_are_those_of_plain_numpy():
    """Of means over 11 px: a twentieth of 99 px on each side; 6 % of the pixels are missing."""
    first, second = bumps(1), bumps(2)
    among = np.random.default_rng(0).random(first.shape) < 0.94
    among[30:45, 40:70] = False
    seen = (
        np.pad(np.where(among, image, 0.0), 5) for image in (np.ones_like(first), first, second)
    )
    count, *totals = (sliding_window_view(image, (11, 11)).sum(axis=(2, 3)) for image in seen)
    full, means = count > 0.8 * 121, [total / np.maximum(count, 1.0) for total in totals]
    slopes = []
    for ahead, behind in ((np.s_[:, 10:], np.s_[:, :-10]), (np.s_[10:], np.s_[:-10])):
        both = full[ahead] & full[behind]
        pair = [(mean[ahead] - mean[behind])[both] for mean in means]
        slopes.append([slope - slope.mean() for slope in pair])
    a, b = (np.concatenate(parts) for parts in zip(*slopes, strict=True))
    expected = (a @ b) / np.sqrt((a @ a) * (b @ b))
    assert slope_correlation(first, second, among) == pytest.approx(expected, abs=1e-5)


def test_of_too_few_pixels_nothing_tells_how_flat_they_are():
    depth, among = bumps(0)[:20, :20].copy(), np.zeros((20, 20), bool)
    among[:5, :5] = True
    assert depth_correlation(depth, depth, among) == (0.0, np.inf)
    among[:6] = True
    assert depth_correlation(depth, depth, among)[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    "compare", [lambda *given: depth_correlation(*given)[0], slope_correlation]
)
def test_place_and_tilt_do_not_matter_but_shape_does(compare):
    y, x = np.mgrid[0.0:80.0, 0.0:100.0]
    first, everywhere = bumps(1), np.ones((80, 100), dtype=bool)
    tilted = np.float32(first + 0.03 + 0.002 * x - 0.001 * y)
    assert compare(first, tilted, everywhere) == pytest.approx(1.0, abs=1e-3)
    assert compare(first, 2.0 - first, everywhere) == pytest.approx(-1.0, abs=1e-3)
    assert abs(compare(first, bumps(5), everywhere)) < 0.8
    assert abs(compare(first, np.float32(1.0 + 0.002 * x), everywhere)) < 0.2
    assert compare(first, tilted, np.zeros((80, 100), dtype=bool)) == 0.0


@pytest.fixture(scope="module")
def observation(scene):
    return scene.seen


@pytest.fixture(scope="module")
def verifier(scene):
    return Verifier(scene.model, SETTINGS)


def test_the_right_pose_fits_better_in_every_respect(scene, observation, verifier):
    right = measure_fit(verifier, observation, scene.pose)
    wrong = measure_fit(verifier, observation, disturbed(scene, 40.0, 20.0, seed=1))
    assert right.cost < wrong.cost
    assert right.depth_correlation > 0.9 and right.slope > 0.9
    assert wrong.depth_correlation < 0.9 and wrong.slope < 0.9
    assert 0.3 < right.residual_mm < 1.2 < wrong.residual_mm
    evidence = verifier.evidence(observation, scene.pose[None])
    assert right.visible_fraction == pytest.approx(1.0 - evidence.occluded[0])
    assert right.cost == pytest.approx(verifier.weigh(evidence)[0])


def test_the_pixels_that_agree_with_an_object_without_colours_are_counted(scene, observation):
    verifier = Verifier(colorless(scene.model), SETTINGS)
    for pose in (scene.pose, disturbed(scene, 40.0, 20.0, seed=1)):
        drawn = render_depth(verifier.mesh, pose[None], CAMERA, observation.depth.shape, threads=1)
        away = np.abs(drawn[0] - observation.depth)
        agreeing = np.count_nonzero((drawn[0] > 0.0) & (away <= verifier.tau_depth))
        assert measure_fit(verifier, observation, pose).pixels == agreeing > 0
    assert measure_fit(Verifier(scene.model, SETTINGS), observation, scene.pose).pixels == np.inf


def test_a_pose_outside_the_image_or_behind_the_camera_fits_nothing(scene, observation, verifier):
    for shift in ([0.0, 0.0, -2.0], [-0.2, 0.0, 0.0], [5.0, 0.0, 0.0]):
        pose = scene.pose.copy()
        pose[:3, 3] += shift
        fit = measure_fit(verifier, observation, pose)
        assert np.isfinite([fit.cost, fit.depth_correlation, fit.slope, fit.visible_fraction]).all()
    assert (fit.depth_correlation, fit.slope, fit.residual_mm) == (0.0, 0.0, np.inf)


@pytest.mark.parametrize(("shift", "axis"), [(0.35, 0), (-0.3, 0), (0.25, 1), (-0.2, 1)])
def test_what_lies_outside_the_image_is_not_visible(scene, observation, verifier, shift, axis):
    pose = scene.pose.copy()
    pose[axis, 3] += shift
    height, width = observation.depth.shape
    moved = CAMERA.copy()
    moved[:2, 2] += [width, height]  # the image lies in the middle of one three times as large
    whole = render_depth(verifier.mesh, pose[None], moved, (3 * height, 3 * width), threads=1)[0]
    inside = np.count_nonzero(whole[height : 2 * height, width : 2 * width])
    expected = inside / max(np.count_nonzero(whole), 1)
    occluded = float(verifier.evidence(observation, pose[None]).occluded[0])
    fit = measure_fit(verifier, observation, pose)
    assert fit.inside_fraction == pytest.approx(expected, abs=0.02)
    assert fit.visible_fraction == pytest.approx(expected * (1.0 - occluded), abs=0.02)


@pytest.mark.parametrize("away", [0.0, 0.22])
def test_a_side_is_narrow_by_its_share_of_the_broadest_and_colours_make_up_for_it(away):
    """Of a carton of 120, 80 and 20 mm, wholly in the image and cut off by its border."""
    carton = model_of(trimesh.creation.box((0.12, 0.08, 0.02)))
    broad, narrow = np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    empty = np.zeros((240, 320, 3), np.uint8), np.ones((240, 320))
    seen = observe(*empty, CAMERA, SETTINGS)
    for model, shares in ((colorless(carton), (1.0, 0.25)), (carton, (1.0, 1.0))):
        verifier = Verifier(model, SETTINGS)
        for rotation, share in zip((broad, narrow), shares, strict=True):
            pose = rigid(rotation, np.array([away, 0.0, 0.8]))
            fit = measure_fit(verifier, seen, pose)
            assert (fit.inside_fraction < 1.0) == (away > 0.0)
            assert fit.projected_share == pytest.approx(share, abs=0.07)  # perspective
