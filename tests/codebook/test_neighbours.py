import numpy as np
import pytest
from surfaces import recall, surface

from hlp.codebook.inverted_lists import InvertedLists, InvertedListsSettings
from hlp.codebook.neighbours import ExactNeighbours, KdForest

FEATURES, QUERIES = surface(3000), surface(700, seed=1)  # more than a block of queries


@pytest.mark.parametrize("neighbours", [1, 3, 50])
def test_exact_search_equals_brute_force(neighbours):
    features, queries = FEATURES[:50].astype(np.float64), QUERIES[:40].astype(np.float64)
    every = np.linalg.norm(queries[:, None] - features, axis=2)
    expected = np.argsort(every, axis=1)[:, :neighbours]
    matches = ExactNeighbours(FEATURES[:50], neighbours).search(QUERIES[:40])
    assert matches.indices.dtype == np.int64 and matches.distances.dtype == np.float32
    np.testing.assert_array_equal(matches.indices, expected)
    np.testing.assert_allclose(
        matches.distances, np.take_along_axis(every, expected, axis=1), rtol=1e-4
    )


def test_a_forest_finds_most_neighbours_and_more_with_more_checks():
    exact = ExactNeighbours(FEATURES, 3).search(QUERIES)
    found = [KdForest(FEATURES, 3, 4, checks, seed=0).search(QUERIES) for checks in (8, 64, 3000)]
    recalls = [recall(matches, exact) for matches in found]
    assert recalls[0] < recalls[1] <= recalls[2]
    assert recalls[1] > 0.85
    assert recalls[2] > 0.999
    expected = np.linalg.norm(FEATURES[found[1].indices] - QUERIES[:, None], axis=2)
    np.testing.assert_allclose(found[1].distances, expected, rtol=1e-4)
    assert (np.diff(found[1].distances, axis=1) >= 0).all()


def test_a_forest_is_a_function_of_its_seed():
    first = KdForest(FEATURES, 3, 4, 16, seed=5).search(QUERIES)
    KdForest(FEATURES, 3, 2, 16, seed=8)
    again = KdForest(FEATURES, 3, 4, 16, seed=5).search(QUERIES)
    np.testing.assert_array_equal(first.indices, again.indices)
    np.testing.assert_array_equal(first.distances, again.distances)
    other = KdForest(FEATURES, 3, 4, 16, seed=6).search(QUERIES)
    assert (first.indices != other.indices).any()


@pytest.mark.parametrize(
    "make",
    [
        lambda features: ExactNeighbours(features, 3),
        lambda features: KdForest(features, 3, 4, 32, seed=0),
        lambda features: InvertedLists(features, InvertedListsSettings(lists=4), seed=0),
    ],
)
def test_small_codebooks_no_queries_and_queries_of_any_layout(make):
    few = make(FEATURES[:2]).search(QUERIES[:5])
    assert few.indices.shape == few.distances.shape == (5, 2)
    assert (np.sort(few.indices, axis=1) == [0, 1]).all()
    search = make(np.tile(FEATURES, (2, 1)))
    none = search.search(QUERIES[:0])
    assert none.indices.shape == none.distances.shape == (0, 3)
    wide = np.asfortranarray(QUERIES[:20].astype(np.float64))
    np.testing.assert_array_equal(search.search(wide).indices, search.search(QUERIES[:20]).indices)
