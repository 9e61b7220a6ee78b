"""One index for the entries of several objects."""

import numpy as np
from test_inverted_lists import surface

from hlp.codebook.inverted_lists import EXACT_BELOW, InvertedLists, JointListsSettings
from hlp.codebook.neighbours import ExactNeighbours

SETTINGS = JointListsSettings()


def test_most_of_the_nearest_entries_of_all_objects_are_found():
    objects = [surface(count, seed=seed) for seed, count in enumerate((EXACT_BELOW, 3000, 5000))]
    queries = surface(400, seed=9)
    found = SETTINGS.build(np.concatenate(objects), 0, 1).search(queries)
    exact = ExactNeighbours(np.concatenate(objects), 3).search(queries)
    pairs = zip(found.indices, exact.indices, strict=True)
    assert sum(len(set(a) & set(b)) for a, b in pairs) / found.indices.size > 0.8


def test_the_number_of_lists_follows_that_of_entries_up_to_a_limit():
    few, many = surface(EXACT_BELOW), surface(4 * EXACT_BELOW)
    limited = JointListsSettings(lists=20)
    lists = [
        each.build(features, 0, 1).settings.lists
        for each, features in ((SETTINGS, few), (SETTINGS, many), (limited, many))
    ]
    assert lists == [EXACT_BELOW // 450, 4 * EXACT_BELOW // 450, 20]


def test_prepared_lists_are_not_trained_again(tmp_path, monkeypatch):
    features, queries = surface(2 * EXACT_BELOW), surface(50, seed=1)
    trained = SETTINGS.build(features, 3, 1).search(queries)
    SETTINGS.prepare(features, 3, tmp_path)
    monkeypatch.setattr("hlp.codebook.inverted_lists._train", lambda *_: 1 / 0)
    read = SETTINGS.build(features, 3, 1, tmp_path)
    assert isinstance(read, InvertedLists)
    np.testing.assert_array_equal(read.search(queries).indices, trained.indices)
