"""The likeliest places of an object in a region, and the squares around a few of them."""

import numpy as np
import pytest

from hlp.patches.likely_places import CloserSettings, likely_places, likely_regions
from hlp.records import Region


def region_of(centers: list[tuple[float, float]], probabilities: list[float]) -> Region:
    mask = np.zeros((60, 80), dtype=bool)
    return Region(4, np.array(centers, float).reshape(-1, 2), np.array(probabilities), mask)


def test_a_window_beside_a_likelier_one_is_no_place_of_its_own() -> None:
    rng = np.random.default_rng(2)
    centers = rng.uniform(0, 60, (200, 2))
    region = Region(4, centers, rng.uniform(0, 1, 200), np.zeros((60, 80), dtype=bool))
    radii = rng.uniform(5, 15, 200)
    rows = likely_places(region, radii, 8)
    assert len(rows) == 8
    expected: list[int] = []  # one after another, by their definition
    for row in np.argsort(-region.probabilities):
        near = [np.linalg.norm(centers[row] - centers[k]) < radii[k] for k in expected]
        if not any(near):
            expected.append(int(row))
    assert rows.tolist() == expected[:8]


def test_improbable_windows_are_no_places() -> None:
    region = region_of([(10, 10), (50, 10), (70, 50)], [0.5, 0.01, 0.3])
    assert likely_places(region, np.full(3, 5.0), 9).tolist() == [0, 2]
    none = region_of([], [])
    assert likely_places(none, np.zeros(0), 9).tolist() == []


def test_squares_of_a_few_places_at_a_time() -> None:
    region = region_of([(10, 10), (40, 10), (70, 50)], [0.2, 0.4, 0.3])
    settings = CloserSettings(places=3, together=2, side=1.0)
    first, second = likely_regions(region, np.full(3, 6.0), settings)
    assert first.object_id == 4 and first.mask.shape == (60, 80)
    y, x = np.nonzero(second.mask)
    assert (x.min(), x.max(), y.min(), y.max()) == (4, 16, 4, 16)
    assert first.mask.sum() == 2 * 169 and first.mask[10, 40] and first.mask[50, 70]


@pytest.mark.parametrize("places", [0, 1])
def test_no_more_places_than_asked_for(places: int) -> None:
    region = region_of([(10, 10), (40, 10)], [0.2, 0.4])
    found = list(likely_regions(region, np.full(2, 6.0), CloserSettings(places=places)))
    assert len(found) == places
