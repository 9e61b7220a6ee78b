"""The likeliest places of an object in a region, and the squares around a few of them."""

import numpy as np
import pytest

from hlp.patches.holistic import union_of_squares
from hlp.patches.window_choice import (
    CloserLookSettings,
    first_region,
    likely_places,
    likely_regions,
)
from hlp.records import Region


def region_of(centers, probabilities):
    mask = np.zeros((60, 80), dtype=bool)
    return Region(4, np.array(centers, float).reshape(-1, 2), np.array(probabilities), mask)


def test_a_window_beside_a_likelier_one_is_no_place_of_its_own():
    rng = np.random.default_rng(2)
    centers = rng.uniform(0, 60, (200, 2))
    region = Region(4, centers, rng.uniform(0, 1, 200), np.zeros((60, 80), dtype=bool))
    radii = rng.uniform(5, 15, 200)
    rows = likely_places(region, radii, 8)
    assert len(rows) == 8
    expected = []  # one after another, by their definition
    for row in np.argsort(-region.probabilities):
        near = [np.linalg.norm(centers[row] - centers[k]) < radii[k] for k in expected]
        if not any(near):
            expected.append(int(row))
    assert rows.tolist() == expected[:8]


def test_improbable_windows_are_no_places():
    region = region_of([(10, 10), (50, 10), (70, 50)], [0.5, 0.01, 0.3])
    assert likely_places(region, np.full(3, 5.0), 9).tolist() == [0, 2]
    none = region_of([], [])
    assert likely_places(none, np.zeros(0), 9).tolist() == []


def test_squares_of_a_few_places_at_a_time():
    region = region_of([(10, 10), (40, 10), (70, 50)], [0.2, 0.4, 0.3])
    settings = CloserLookSettings(places=3, together=2, side=1.0)
    first, second = likely_regions(region, np.full(3, 6.0), settings)
    assert first.object_id == 4 and first.mask.shape == (60, 80)
    y, x = np.nonzero(second.mask)
    assert (x.min(), x.max(), y.min(), y.max()) == (4, 16, 4, 16)
    assert first.mask.sum() == 2 * 169 and first.mask[10, 40] and first.mask[50, 70]


@pytest.mark.parametrize("places", [None, 1])
def test_no_more_places_than_asked_for(places):
    region = region_of([(10, 10), (40, 10)], [0.2, 0.4])
    found = list(likely_regions(region, np.full(2, 6.0), CloserLookSettings(places=places)))
    assert len(found) == (places or 0)


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
    order = np.argsort(-probabilities)
    areas = [
        union_of_squares(centers[order[:n]], radii[order[:n]] * 0.7, (480, 640)) for n in range(99)
    ]
    assert any((found.mask == area).all() for area in areas)


def test_a_small_region_is_searched_whole():
    mask = np.zeros((60, 80), dtype=bool)
    mask[10:30, 10:30] = True
    region = Region(4, np.array([[20.0, 20.0]]), np.array([0.9]), mask)
    radii = np.array([6.0])
    assert first_region(region, radii, 0.7, CloserLookSettings(first_area=3.0)) is region
    assert first_region(region, radii, 0.7, CloserLookSettings(first_area=None)) is region
    least = first_region(region, radii, 0.7, CloserLookSettings(first_area=0.01))
    assert np.count_nonzero(least.mask) == 9 * 9  # the likeliest window's square
    nothing = Region(4, np.zeros((0, 2)), np.zeros(0), np.zeros((60, 80), dtype=bool))
    assert first_region(nothing, np.zeros(0), 0.7, CloserLookSettings()) is nothing
