"""Inverted lists of one object, and of all objects in one index, beside an exact search."""

import dataclasses

import faiss
import numpy as np
import pytest
from surfaces import recall, surface

from hlp.codebook.inverted_lists import (
    EXACT_BELOW,
    InvertedLists,
    InvertedListsSettings,
    JointListsSettings,
    load_lists,
)
from hlp.codebook.neighbours import ExactNeighbours
from hlp.errors import DataError

SETTINGS = InvertedListsSettings("inverted_lists", 3, lists=32, probes=8, candidates=16)


FEATURES, QUERIES = surface(2 * EXACT_BELOW), surface(600, seed=1)
EXACT = ExactNeighbours(FEATURES, 3).search(QUERIES)


def test_most_neighbours_are_found_and_more_with_more_probes_and_candidates():
    few = dataclasses.replace(SETTINGS, probes=1)
    hasty = dataclasses.replace(SETTINGS, candidates=1)
    every = dataclasses.replace(SETTINGS, probes=32, candidates=200)
    found = (
        InvertedLists(FEATURES, each, 0).search(QUERIES) for each in (few, hasty, SETTINGS, every)
    )
    recalls = [recall(matches, EXACT) for matches in found]
    assert max(recalls[:2]) < recalls[2] - 0.05
    assert recalls[2] > 0.9
    assert recalls[3] > 0.999


def test_lists_are_a_function_of_the_seed_and_threads_change_nothing():
    first, again = (InvertedLists(FEATURES, SETTINGS, 5, threads=n).search(QUERIES) for n in (1, 2))
    np.testing.assert_array_equal(first.indices, again.indices)
    np.testing.assert_array_equal(first.distances, again.distances)
    other = InvertedLists(FEATURES, SETTINGS, 6).search(QUERIES)
    assert (first.indices != other.indices).any()


def test_small_codebooks_are_searched_exactly():
    few = InvertedLists(FEATURES[: EXACT_BELOW - 1], SETTINGS, seed=0).search(QUERIES)
    exact = ExactNeighbours(FEATURES[: EXACT_BELOW - 1], 3).search(QUERIES)
    np.testing.assert_array_equal(few.indices, exact.indices)
    np.testing.assert_allclose(few.distances, exact.distances, rtol=1e-3)


def test_what_the_lists_do_not_hold_is_infinitely_far():
    """All entries but two in one place: the nearest list holds a single one."""
    features = np.zeros((EXACT_BELOW, 24), dtype=np.float32)
    features[0, 0] = features[1, 1] = 1.0
    lone = dataclasses.replace(SETTINGS, lists=3, probes=1)
    matches = InvertedLists(features, lone, seed=0).search(features[:1])
    assert matches.indices[0, 0] == 0 and matches.distances[0, 0] == 0.0
    missing = ~np.isfinite(matches.distances[0])
    assert missing.sum() == 2
    assert (matches.indices >= 0).all()


def test_stored_lists_may_be_searched_otherwise_than_they_were_learnt_for():
    trained = InvertedLists(FEATURES, SETTINGS, seed=0)
    other = dataclasses.replace(SETTINGS, probes=1)
    restored = InvertedLists(FEATURES, other, seed=0, trained=trained.trained)
    fresh = InvertedLists(FEATURES, other, seed=0)
    np.testing.assert_array_equal(restored.search(QUERIES).indices, fresh.search(QUERIES).indices)


def test_stored_lists_of_something_else_are_refused():
    stored = InvertedLists(FEATURES, SETTINGS, seed=0).trained
    more = dataclasses.replace(SETTINGS, lists=33)
    for features, settings in ((FEATURES[:-1], SETTINGS), (FEATURES, more)):
        with pytest.raises(DataError, match="other features or settings"):
            InvertedLists(features, settings, seed=0, trained=stored)
    with pytest.raises(DataError, match="damaged"):
        InvertedLists(FEATURES, SETTINGS, seed=0, trained=stored[: len(stored) // 2].copy())


def test_search_equals_faiss_refinement():
    """The candidates compared as faiss.IndexRefineFlat does, without its copy of the features."""
    coarse = faiss.IndexFlatL2(24)
    short = faiss.IndexIVFPQFastScan(coarse, 24, SETTINGS.lists, 6, 4)
    short.cp.seed = short.pq.cp.seed = 0
    short.nprobe = SETTINGS.probes
    index = faiss.IndexRefineFlat(short)
    index.k_factor = SETTINGS.candidates
    faiss.omp_set_num_threads(1)
    index.train(FEATURES)
    index.add(FEATURES)
    squared, indices = index.search(QUERIES, 3)
    found = InvertedLists(FEATURES, SETTINGS, seed=0).search(QUERIES)
    np.testing.assert_array_equal(found.indices, indices)
    np.testing.assert_allclose(found.distances, np.sqrt(squared), rtol=1e-4, atol=1e-5)


def test_lists_lie_beside_a_codebook(tmp_path, monkeypatch):
    assert load_lists(tmp_path, SETTINGS, seed=0) is None
    trained = SETTINGS.build(FEATURES, 0, 1).search(QUERIES)
    SETTINGS.prepare(FEATURES, 0, tmp_path)
    assert load_lists(tmp_path, SETTINGS, seed=1) is None
    assert load_lists(tmp_path, dataclasses.replace(SETTINGS, lists=33), seed=0) is None
    monkeypatch.setattr("hlp.codebook.inverted_lists._train", lambda *_: 1 / 0)
    read = SETTINGS.build(FEATURES, 0, 1, tmp_path).search(QUERIES)
    np.testing.assert_array_equal(read.indices, trained.indices)
    np.testing.assert_array_equal(read.distances, trained.distances)
    SETTINGS.prepare(FEATURES[:9], 0, tmp_path)
    assert load_lists(tmp_path, SETTINGS, seed=0) is None  # searched exactly: nothing to load


JOINT = JointListsSettings()


def test_the_number_of_lists_follows_that_of_entries_up_to_a_limit():
    few, many = surface(EXACT_BELOW), surface(4 * EXACT_BELOW)
    limited = JointListsSettings(lists=20)
    lists = [
        each.build(features, 0, 1).settings.lists
        for each, features in ((JOINT, few), (JOINT, many), (limited, many))
    ]
    assert lists == [EXACT_BELOW // 450, 4 * EXACT_BELOW // 450, 20]
