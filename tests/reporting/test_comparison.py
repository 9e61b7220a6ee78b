import csv
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from hlp.reporting.comparison import (
    compare_runs,
    difference_interval,
    differences_table,
    flips_table,
    mcnemar_exact,
    read_scored,
)

COLUMNS = (
    "scene_id", "im_id", "obj_id", "object", "found", "visible_fraction", "add_mm", "rotation_deg",
    "translation_mm", "box_iou", "add_correct", "pose_correct", "box_correct",
)  # fmt: skip


def write(path: Path, verdicts: dict[tuple[int, int], bool]) -> Path:
    """`scores.csv` of one scene: image and object → right by AD, 5cm5deg and IoU alike."""
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        for (image, object_id), right in verdicts.items():
            error = 2.0 if right else 40.0
            row = [1, image, object_id, {5: "can", 6: "cat"}[object_id], 1, 0.75]
            writer.writerow([*row, error, error, error, 0.9, *[int(right)] * 3])
    return path


@pytest.mark.parametrize(("lost", "gained"), [(0, 0), (0, 5), (1, 9), (3, 3), (12, 30), (7, 6)])
def test_mcnemar_is_the_sum_of_binomial_tails(lost: int, gained: int) -> None:
    """statsmodels' formula (`mcnemar(exact=True)`): twice the smaller tail at p = ½, at most 1."""
    total = lost + gained
    tail = sum(math.comb(total, i) for i in range(min(lost, gained) + 1)) / 2**total
    assert mcnemar_exact(lost, gained) == pytest.approx(min(1.0, 2.0 * tail), rel=1e-12)
    assert mcnemar_exact(gained, lost) == mcnemar_exact(lost, gained)


def test_interval_is_that_of_all_resamples() -> None:
    """Five frames have 5⁵ resamples: the interval from every one of them, each as likely."""
    frames = np.array([0, 0, 0, 1, 1, 2, 3, 3, 3, 3, 4])
    first = np.array([1, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1], dtype=bool)
    second = np.array([1, 1, 1, 0, 0, 1, 1, 1, 0, 1, 0], dtype=bool)
    differences = []
    for drawn in itertools.product(range(5), repeat=5):
        chosen = np.concatenate([np.flatnonzero(frames == frame) for frame in drawn])
        differences.append(second[chosen].mean() - first[chosen].mean())
    exact = np.percentile(differences, [2.5, 97.5])
    found = difference_interval(first, second, frames, 20_000, seed=1)
    np.testing.assert_allclose(found, exact, atol=0.02)


def test_pairing_narrows_the_interval() -> None:
    """Runs that agree in all but one target differ by at most that one; unpaired they would not."""
    rng = np.random.default_rng(0)
    first = rng.random(60) < 0.5
    second = first.copy()
    second[7] = ~first[7]
    low, high = difference_interval(first, second, np.arange(60), 2000, seed=0)
    assert max(abs(low), abs(high)) <= 4 / 60


def test_tables_say_who_is_right_where(tmp_path: Path) -> None:
    before = {(0, 5): True, (1, 5): True, (2, 5): True, (0, 6): False, (1, 6): False}
    after = {(0, 5): True, (1, 5): False, (2, 5): True, (0, 6): True, (1, 6): True}
    first = read_scored(write(tmp_path / "a.csv", before))
    second = read_scored(write(tmp_path / "b.csv", after))
    pairs = [(target, first[target], second[target]) for target in sorted(first)]
    rows = [list(row) for row in differences_table(pairs, "add").rows]
    columns = [row[:5] + row[6:] for row in rows]
    assert columns == [
        ["can", "3", "1.000", "0.667", "-0.333", "1", "0", "1"],
        ["cat", "2", "0.000", "1.000", "+1.000", "0", "2", "0.5"],
        ["all targets", "5", "0.600", "0.800", "+0.200", "1", "2", "1"],
    ]
    assert rows[1][5] == "+1.000 to +1.000"
    assert [list(row) for row in flips_table(pairs).rows] == [
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
    assert "No target flipped by AD." in said
    assert "| cat | 2 |" in compare_runs(first, second, ("a", "b"), "markdown")


def test_what_cannot_be_compared_is_named(tmp_path: Path) -> None:
    first = write(tmp_path / "a.csv", {(0, 6): True})
    other = write(tmp_path / "b.csv", {(1, 6): True})
    with pytest.raises(ValueError, match="no target in common"):
        compare_runs(first, other, ("a", "b"), "text")
    with pytest.raises(ValueError, match="choose one of"):
        compare_runs(first, first, ("a", "b"), "html")
    (tmp_path / "c.csv").write_text("scene_id,im_id\n1,2\n")
    with pytest.raises(ValueError, match=r"c\.csv, line 2: no score"):
        compare_runs(first, tmp_path / "c.csv", ("a", "b"), "text")
