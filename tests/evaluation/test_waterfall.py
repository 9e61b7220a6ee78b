import dataclasses

import numpy as np
import pytest

from hlp.evaluation.waterfall import (
    CAUSES,
    CORRECT,
    TargetCounts,
    VoteCounts,
    cause_of,
    count_causes,
    visibility_class,
    vote_quality,
)
from hlp.records import TargetScore


def _none(count):
    return np.zeros(count, dtype=bool)


# A target for which every stage did its part but the last: the right pose was not chosen.
FINE = dict(
    counts=TargetCounts(visible=1000, with_depth=900, windows=12, in_region=800, good_votes=50),
    near_basin=np.array([False, True, False, True]),
    refined=np.array([0, 1]),
    right=np.array([False, True]),
    flipped=False,
)


def _with(results, **counts):
    return results | {"counts": dataclasses.replace(results["counts"], **counts)}


NOT_RIGHT = FINE | {"right": _none(2)}
NOT_REFINED = NOT_RIGHT | {"refined": np.array([0, 2])}
NOT_NEAR = NOT_RIGHT | {"near_basin": _none(4)}
FEW = _with(NOT_NEAR, good_votes=4)
NO_REGION = _with(FEW, in_region=249)
NO_WINDOW = _with(NO_REGION, windows=0)
NO_DEPTH = _with(NO_WINDOW, with_depth=499)
FLIPPED = FINE | {"flipped": True}


@pytest.mark.parametrize(
    ("cause", "results"),
    [
        ("symmetric_flip", FLIPPED),
        ("ranking", FINE),
        ("refiner_diverged", NOT_RIGHT),
        ("screening", NOT_REFINED),
        ("outside_basin", NOT_NEAR),
        ("few_votes", FEW),
        ("wrong_region", NO_REGION),
        ("no_window", NO_WINDOW),
        ("depth_missing", NO_DEPTH),
    ],
)
def test_every_cause_has_its_case(cause, results):
    assert cause_of(**results) == cause


def test_at_its_bound_a_stage_still_did_its_part():
    at_bounds = _with(NOT_NEAR, good_votes=5, in_region=250, windows=1)
    assert cause_of(**_with(at_bounds, with_depth=500)) == "outside_basin"


def test_a_later_stage_that_did_its_part_clears_those_before_it():
    lucky = NO_DEPTH | {"near_basin": FINE["near_basin"]}
    assert cause_of(**lucky) == "refiner_diverged"
    assert cause_of(**lucky | {"right": FINE["right"]}) == "ranking"


def test_a_hidden_target_without_any_hypothesis_has_no_window():
    poses = {"near_basin": _none(0), "refined": np.zeros(0, dtype=int), "right": _none(0)}
    assert cause_of(TargetCounts(0, 0, 0, 0, 0), **poses, flipped=False) == "no_window"


@pytest.mark.parametrize(
    ("fraction", "name"),
    [
        (0.0, "0-0.1"),
        (0.1, "0.1-0.3"),
        (0.299, "0.1-0.3"),
        (0.3, "0.3-0.6"),
        (0.6, "0.6-1"),
        (1.0, "0.6-1"),
        (float("nan"), "not stated"),
    ],
)
def test_classes_of_the_visible_fraction(fraction, name):
    assert visibility_class(fraction) == name


def _score(object_id, fraction, cause=""):
    right = not cause
    return TargetScore(
        6, 0, object_id, True, fraction, 0.1, 0.1, 0.1, 0.5, right, right, right, cause=cause
    )


def test_counts_add_up_in_all_and_in_every_class():
    scores = [
        _score(2, 0.2, "wrong_region"),
        _score(1, 0.7),
        _score(1, 0.8, "ranking"),
        _score(2, 0.9),
        _score(2, 0.25, "wrong_region"),
    ]
    counts = count_causes(scores, {1: "cat", 2: "ape", 3: "can"})
    assert list(counts["total"]) == [CORRECT, *CAUSES]
    assert {name: n for name, n in counts["total"].items() if n} == {
        "correct": 2,
        "wrong_region": 2,
        "ranking": 1,
    }
    assert list(counts["per_object"]) == ["cat", "ape"]
    assert counts["per_object"]["ape"]["wrong_region"] == 2
    assert counts["per_object"]["cat"]["ranking"] == 1
    assert list(counts["per_visibility"]) == ["0.1-0.3", "0.6-1"]
    assert counts["per_visibility"]["0.1-0.3"]["wrong_region"] == 2
    assert counts["per_visibility"]["0.6-1"]["correct"] == 2
    for groups in (counts["per_object"], counts["per_visibility"]):
        assert sum(sum(group.values()) for group in groups.values()) == len(scores)


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
    names = ("good", "good_weight", "by_object", "good_by_object", "votes")
    total = dict(zip(names, (0.25, 0.5, 0.5, pytest.approx(7 / 20), 40 / 3), strict=True))
    assert quality["total"] == total
    assert list(quality["per_object"]) == ["cat", "ape"]
    assert [quality["per_object"]["ape"][name] for name in names] == [0.1, 0.25, 0.5, 0.2, 5.0]
    assert vote_quality(counts[2:], {2: "ape"})["total"] == {**dict.fromkeys(names), "votes": 0.0}
