import numpy as np
import pytest

from hlp.evaluation.waterfall import VoteCounts, vote_quality


def test_votes_are_counted_with_their_weight_and_by_who_cast_them():
    good = np.array([True, False, True, False])
    on_object = np.array([True, True, False, False])
    counts = VoteCounts.of(7, good, np.array([1.0, 2.0, 4.0, 8.0]), on_object)
    assert counts == VoteCounts(7, 4, 2, 15.0, 5.0, 2, 1)


def test_shares_are_of_all_votes_and_none_without_votes():
    counts = [
        VoteCounts(2, 10, 1, 4.0, 1.0, 5, 1),
        VoteCounts(1, 30, 9, 16.0, 9.0, 15, 6),
        VoteCounts(2, 0, 0, 0.0, 0.0, 0, 0),
    ]
    quality = vote_quality(counts, {1: "cat", 2: "ape", 3: "can"})
    assert quality["total"] == {
        "good": 0.25,
        "good_weight": 0.5,
        "by_object": 0.5,
        "good_by_object": pytest.approx(7 / 20),
        "votes": pytest.approx(40 / 3),
    }
    assert list(quality["per_object"]) == ["cat", "ape"]
    assert quality["per_object"]["ape"] == {
        "good": 0.1,
        "good_weight": 0.25,
        "by_object": 0.5,
        "good_by_object": 0.2,
        "votes": 5.0,
    }
    nothing = vote_quality([VoteCounts(2, 0, 0, 0.0, 0.0, 0, 0)], {2: "ape"})["total"]
    shares = ("good", "good_weight", "by_object", "good_by_object")
    assert nothing == {**dict.fromkeys(shares), "votes": 0.0}
