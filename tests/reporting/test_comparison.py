import math
from pathlib import Path

import numpy as np
import pytest

from hlp.records import TargetScore
from hlp.reporting.comparison import (
    changes_table,
    compare_runs,
    differences_table,
    mcnemar_exact,
    read_targets,
)
from hlp.results.poses_file import write_scores
from table_text import unpadded

NAMES = {5: "can", 6: "cat"}


def score(image: int, object_id: int, right: bool) -> TargetScore:
    """A target that is right by ADD(-S), 5cm5deg and IoU alike, or by none of them."""
    metres, radians = (0.002, np.deg2rad(2.0)) if right else (0.04, np.deg2rad(40.0))
    return TargetScore(
        1, image, object_id, True, 0.75, metres, radians, metres, 0.9, right, right, right
    )


def write(path: Path, verdicts: dict[tuple[int, int], bool]) -> Path:
    """`scores.csv` of one scene: image and object → right or wrong."""
    write_scores(path, [score(*target, right) for target, right in verdicts.items()], NAMES)
    return path


@pytest.mark.parametrize(("lost", "gained"), [(0, 0), (0, 5), (1, 9), (3, 3), (12, 30), (7, 6)])
def test_mcnemar_is_the_sum_of_binomial_tails(lost: int, gained: int) -> None:
    """statsmodels' formula (`mcnemar(exact=True)`): twice the smaller tail at p = ½, at most 1."""
    total = lost + gained
    tail = sum(math.comb(total, i) for i in range(min(lost, gained) + 1)) / 2**total
    assert mcnemar_exact(lost, gained) == pytest.approx(min(1.0, 2.0 * tail), rel=1e-12)
    assert mcnemar_exact(gained, lost) == mcnemar_exact(lost, gained)


def test_tables_say_who_is_right_where(tmp_path: Path) -> None:
    before = {(0, 5): True, (1, 5): True, (2, 5): True, (0, 6): False, (1, 6): False}
    after = {(0, 5): True, (1, 5): False, (2, 5): True, (0, 6): True, (1, 6): True}
    first = read_targets(write(tmp_path / "a.csv", before))
    second = read_targets(write(tmp_path / "b.csv", after))
    pairs = [(target, first[target], second[target]) for target in sorted(first)]
    rows = [list(row) for row in differences_table(pairs, "add").rows]
    columns = [row[:5] + row[6:] for row in rows]
    assert columns == [
        ["can", "3", "1.000", "0.667", "-0.333", "1", "0", "1"],
        ["cat", "2", "0.000", "1.000", "+1.000", "0", "2", "0.5"],
        ["all targets", "5", "0.600", "0.800", "+0.200", "1", "2", "1"],
    ]
    assert rows[1][5] == "+0.070 to +1.000"  # of two targets
    assert [list(row) for row in changes_table(pairs).rows] == [
        ["lost", "1/1", "can", "0.75", "2.0", "40.0", "2.0", "40.0"],
        ["gained", "1/0", "cat", "0.75", "40.0", "2.0", "40.0", "2.0"],
        ["gained", "1/1", "cat", "0.75", "40.0", "2.0", "40.0", "2.0"],
    ]


def test_only_targets_of_both_are_compared(tmp_path: Path) -> None:
    first = write(tmp_path / "a.csv", {(0, 6): True, (1, 6): True, (2, 6): False})
    second = write(tmp_path / "b.csv", {(1, 6): True, (2, 6): False, (3, 6): True})
    said = compare_runs(first, second, ("runs/a", "runs/b"), "text")
    assert "A = runs/a\nB = runs/b" in said
    assert "2 targets in common; left out: 1 targets that only A has, 1 that only B has" in said
    assert "No verdict of ADD(-S) changed." in said
    assert "| cat | 2 |" in unpadded(compare_runs(first, second, ("a", "b"), "markdown"))


def test_what_cannot_be_compared_is_named(tmp_path: Path) -> None:
    first = write(tmp_path / "a.csv", {(0, 6): True})
    other = write(tmp_path / "b.csv", {(1, 6): True})
    with pytest.raises(ValueError, match="no target in common"):
        compare_runs(first, other, ("a", "b"), "text")
    (tmp_path / "c.csv").write_text("scene_id,im_id\n1,2\n")
    with pytest.raises(
        ValueError, match=r"c\.csv: the first line must be scene_id,im_id,obj_id,object"
    ):
        compare_runs(first, tmp_path / "c.csv", ("a", "b"), "text")
