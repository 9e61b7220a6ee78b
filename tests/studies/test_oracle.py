import math

import pytest

from hlp.records import TargetScore
from hlp.studies.oracle import CELLS, summarise_oracle

NAMES = {1: "cat", 2: "cup"}


class Policy:
    bootstrap = 200


def score(frame, object_id, right):
    return TargetScore(
        0, frame, object_id, True, 1.0, math.nan, 0.0, 0.0, 1.0, right, not right, True
    )


def scores(cat, cup):
    """Of ten frames with both objects the first `cat` and `cup` are right."""
    return [score(i, 2, i < cup) for i in range(10)] + [score(i, 1, i < cat) for i in range(10)]


RIGHT = {
    ("estimated", "estimated"): (6, 2),
    ("true", "estimated"): (8, 3),
    ("estimated", "true"): (9, 8),
    ("true", "true"): (10, 9),
}


def test_the_matrix_counts_right_poses_by_cell_and_object():
    assert set(CELLS) == set(RIGHT)
    result = summarise_oracle({c: scores(*RIGHT[c]) for c in CELLS}, NAMES, Policy, 0)
    assert [(cell["region"], cell["coarse"]) for cell in result["cells"]] == list(CELLS)
    for cell in result["cells"]:
        cat, cup = RIGHT[cell["region"], cell["coarse"]]
        assert cell["add"]["targets"] == 20
        assert cell["add"]["recall"] == pytest.approx((cat + cup) / 20)
        assert list(cell["per_object"]) == ["cat", "cup"]
        for name, right in (("cat", cat), ("cup", cup)):
            found = cell["per_object"][name]
            assert (found["targets"], found["recall"]) == (10, pytest.approx(right / 10))
            low, high = found["ci95"]
            assert low <= right / 10 <= high and (low < high or right in (0, 10))


def test_what_the_stages_lost_sums_to_all_misses():
    result = summarise_oracle({c: scores(*RIGHT[c]) for c in CELLS}, NAMES, Policy, 0)
    assert result["lost"] == {
        "region": pytest.approx(3 / 20),  # 8 right become 11 with the true region
        "coarse pose": pytest.approx(8 / 20),  # … and 19 with the true coarse pose as well
        "fine pose": pytest.approx(1 / 20),
    }
    assert sum(result["lost"].values()) == pytest.approx(1 - 8 / 20)
