import numpy as np
import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.patches.holistic import Windows
from hlp.patches.local import GridSettings
from hlp.patches.region import (
    CloserLookSettings,
    RegionSettings,
    candidate_region,
    first_region,
    likely_places,
    likely_regions,
    object_radii,
    patch_pixels,
    region_pixels,
    region_weights,
    thin_out,
    union_of_squares,
)
from hlp.records import Frame, Region


def windows_at(centers, sides):
    return Windows(np.asarray(centers, float), np.ones(len(sides)), np.asarray(sides, float))


@pytest.mark.parametrize(
    ("probabilities", "best", "threshold", "min_windows", "accepted"),
    [
        ([0.4, 0.9, 0.3], [1, 0, 1], None, 0, [1, 0, 1]),  # the most likely class
        ([0.1, 0.2], [0, 0], None, 0, [0, 0]),
        ([0.06, 0.5], [0, 1], None, 8, [1, 1]),  # the most probable make up for too few
        ([0.06, 0.2, 0.05, 0.04], [0] * 4, 0.3, 3, [1, 1, 1, 0]),
        ([0.02, 0.5, 0.051, 0.01], [0] * 4, 0.3, 3, [0, 1, 1, 0]),  # but not far less probable ones
        ([0.0] * 4, [0] * 4, 0.3, 3, [1, 1, 1, 0]),
        ([], [], 0.1, 4, []),
    ],
)
def test_which_windows_are_accepted(probabilities, best, threshold, min_windows, accepted):
    count = len(probabilities)
    windows = windows_at(np.arange(count)[:, None] * [10, 0] + 5, [4.0] * count)
    settings = RegionSettings(8, threshold, min_windows, 1.0, "exact")
    given = np.array(probabilities), np.array(best, bool)
    found = candidate_region(7, windows, *given, (10, 10 * count + 1), 1.0, settings)
    assert found.object_id == 7
    assert found.mask[5, 5::10][:count].tolist() == [bool(one) for one in accepted]
    assert given[1].tolist() == [bool(one) for one in best]  # the caller's array stays as it was
    np.testing.assert_array_equal(found.probabilities, probabilities)


@pytest.mark.parametrize(("reach", "extent", "scale"), [(None, 3.0, 1.0), (0.6, 1.5, 0.9)])
def test_the_mask_is_the_union_of_the_squares(reach, extent, scale):
    rng = np.random.default_rng(2)
    shape = (60, 80)
    centers = np.stack([rng.integers(0, 80, 25), rng.integers(0, 60, 25)], axis=1)
    sides = rng.uniform(2, 30, 25)
    found = candidate_region(
        1, windows_at(centers, sides), np.ones(25), np.ones(25, bool), shape, extent,
        RegionSettings(8, None, 0, reach, "exact"),
    )  # fmt: skip
    expected = np.zeros(shape, bool)
    y, x = np.mgrid[: shape[0], : shape[1]]
    for (cx, cy), side in zip(centers, sides, strict=True):
        half = scale * side / 2
        across = (np.rint(cx - half) <= x) & (x <= np.rint(cx + half))
        expected |= across & (np.rint(cy - half) <= y) & (y <= np.rint(cy + half))
    assert 0.2 < expected.mean() < 1.0
    np.testing.assert_array_equal(found.mask, expected)


def test_region_weight_is_the_highest_probability_of_the_windows_near_a_pixel():
    rng = np.random.default_rng(0)
    centers, pixels = rng.uniform(0.0, 100.0, (40, 2)), rng.uniform(0.0, 100.0, (300, 2))
    probabilities, radii = rng.uniform(0.0, 1.0, 40) ** 4, rng.uniform(5.0, 30.0, 300)
    near = np.linalg.norm(pixels[:, None] - centers, axis=2) <= radii[:, None]
    expected = np.maximum((near * probabilities).max(axis=1), 0.01)
    assert 0.05 < (expected == 0.01).mean() < 0.5
    region = Region(1, centers, probabilities, np.ones((60, 240), bool))
    np.testing.assert_array_equal(region_weights(region, pixels, radii), expected)
    assert region_weights(region, np.zeros((0, 2)), np.zeros(0)).shape == (0,)
    nothing = Region(1, centers[:0], probabilities[:0], region.mask)
    assert (region_weights(nothing, pixels, radii) == 0.01).all()


def region_of(centers, probabilities):
    mask = np.zeros((60, 80), dtype=bool)
    return Region(4, np.array(centers, float).reshape(-1, 2), np.array(probabilities), mask)


def test_a_window_beside_a_likelier_one_is_no_place_of_its_own():
    rng = np.random.default_rng(2)
    centers = rng.uniform(0, 60, (200, 2))
    region = region_of(centers, rng.uniform(0, 1, 200))
    radii = rng.uniform(5, 15, 200)
    rows = likely_places(region, radii, 8, 0.02)
    assert len(rows) == 8
    expected = []  # one after another, by their definition
    for row in np.argsort(-region.probabilities):
        near = [np.linalg.norm(centers[row] - centers[k]) < radii[k] for k in expected]
        if not any(near):
            expected.append(int(row))
    assert rows.tolist() == expected[:8]


def test_improbable_windows_are_no_places():
    region = region_of([(10, 10), (50, 10), (70, 50)], [0.5, 0.01, 0.3])
    assert likely_places(region, np.full(3, 5.0), 9, 0.02).tolist() == [0, 2]
    assert likely_places(region_of([], []), np.zeros(0), 9, 0.02).tolist() == []


def test_squares_of_a_few_places_at_a_time():
    region = region_of([(10, 10), (40, 10), (70, 50)], [0.2, 0.4, 0.3])
    settings = CloserLookSettings(places=3, places_at_once=2, side=1.0)
    first, second = likely_regions(region, np.full(3, 6.0), settings, False, False)
    assert first.object_id == 4 and first.mask.shape == (60, 80)
    y, x = np.nonzero(second.mask)
    assert (x.min(), x.max(), y.min(), y.max()) == (4, 16, 4, 16)
    assert first.mask.sum() == 2 * 169 and first.mask[10, 40] and first.mask[50, 70]


def test_as_many_places_as_asked_for():
    region, radii = region_of([(10, 10), (40, 10), (70, 50)], [0.2, 0.4, 0.1]), np.full(3, 6.0)
    for most, known, colored, found in [(None, 1, 1, 0), (1, 1, 0, 1), (3, 0, 0, 2), (1, 1, 1, 3)]:
        settings = CloserLookSettings(places=most, places_at_once=1)
        assert len([*likely_regions(region, radii, settings, known, colored)]) == found
    many, one = region_of([(5 * k, 0) for k in range(16)], [0.5] * 16), np.full(16, 4.0)
    settings = CloserLookSettings(places=12, places_at_once=1)  # of 16; if it may be absent:
    assert [len([*likely_regions(many, one, settings, False, c)]) for c in (0, 1)] == [12, 9]


def test_of_a_large_region_the_likeliest_windows_come_first():
    rng = np.random.default_rng(5)
    centers, probabilities = rng.uniform(0, (640, 480), (400, 2)), rng.uniform(0, 1, 400)
    radii = np.full(400, 40.0)
    everything = union_of_squares(centers, radii * 0.7, (480, 640))
    region = Region(4, centers, probabilities, everything)
    found = first_region(region, radii, 0.7, CloserLookSettings(first_area=6.0))
    assert np.count_nonzero(found.mask) == pytest.approx(6.0 * 80.0**2, rel=0.15)
    three = first_region(region, radii, 0.7, CloserLookSettings(first_area=2.0), 3)
    assert np.array_equal(three.mask, found.mask)
    # One square after the other, until the area is reached.
    order, half = np.argsort(-probabilities), radii * 0.7
    areas = [union_of_squares(centers[order[:n]], half[:n], (480, 640)) for n in range(99)]
    assert any((found.mask == area).all() for area in areas)


def test_a_small_region_is_searched_whole():
    radii, region = np.array([6.0]), region_of([(20, 20)], [0.9])
    region.mask[10:30, 10:30] = True
    assert first_region(region, radii, 0.7, CloserLookSettings(first_area=3.0)) is region
    assert first_region(region, radii, 0.7, CloserLookSettings(first_area=None)) is region
    least = first_region(region, radii, 0.7, CloserLookSettings(first_area=0.01))
    assert np.count_nonzero(least.mask) == 9 * 9  # the likeliest window's square
    nothing = region_of([], [])
    assert first_region(nothing, np.zeros(0), 0.7, CloserLookSettings()) is nothing


def test_region_pixels_lie_in_the_region():
    mask = np.zeros((64, 64), bool)
    mask[16:48, 8:56] = True
    every = region_pixels(mask, 8)
    assert len(every) == 4 * 6 and mask[every[:, 1], every[:, 0]].all()
    assert len(region_pixels(~np.ones((64, 64), bool), 8)) == 0


@pytest.mark.parametrize("count", [1, 7, 50, 400, 999])
def test_density_follows_the_weights(count):
    rng = np.random.default_rng(count)
    weights = np.where(np.arange(1000) < 300, 0.9, 0.01) * rng.uniform(0.8, 1.2, 1000)
    chosen = thin_out(weights, count)
    assert count - 1 <= len(chosen) <= count and (np.diff(chosen) > 0).all()
    expected = min(300.0, count * weights[:300].sum() / weights.sum())
    assert abs(np.count_nonzero(chosen < 300) - expected) <= 3


def test_few_items_are_all_kept_and_equal_weights_thin_evenly():
    np.testing.assert_array_equal(thin_out(np.ones(5), 9), np.arange(5))
    np.testing.assert_array_equal(np.diff(thin_out(np.full(90, 0.3), 30)), np.full(29, 3))


def test_most_patches_are_at_likely_windows():
    mask, centers = np.ones((240, 320), bool), np.array([[60.0, 60.0], [200.0, 150.0]])
    region = Region(1, centers, np.array([0.9, 0.02]), mask)
    seen = np.zeros((*mask.shape, 3), np.uint8), np.full(mask.shape, 0.8, np.float32)
    frame = Frame(1, 1, *seen, np.diag([400.0, 400.0, 1.0]))
    model = next(iter(demo_objects().values()))
    np.testing.assert_allclose(object_radii(frame, centers, model), 250.0 * model.diameter)
    pixels = patch_pixels(frame, region, model, GridSettings(max_patches=50))
    near = np.linalg.norm(pixels - centers[0], axis=1) <= 250.0 * model.diameter
    assert 49 <= len(pixels) <= 50 and near.mean() > 0.8
    few = patch_pixels(frame, region, model, GridSettings(max_patches=50), share=0.25)
    assert len(few) in (11, 12) and {*map(tuple, few)} < {*map(tuple, pixels)}
