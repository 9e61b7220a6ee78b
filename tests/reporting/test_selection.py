"""Recall of chosen objects, by how much of a target is visible."""

from pathlib import Path

import pytest

from hlp.records import TargetScore
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.run_list import report_selection, selection_table


def scored(name: str, visible: float, right: bool, box: bool = True) -> ScoredTarget:
    score = TargetScore(1, 2, 3, True, visible, 0.001, 0.1, 0.001, 0.9, right, False, box)
    return ScoredTarget(name, score)


SCORES = [
    scored("cat", 0.9, True),
    scored("cat", 0.6, True),
    scored("cat", 0.5, False),
    scored("duck", 0.7, False, box=False),
    scored("glue", 0.2, True),
]


def test_targets_of_other_objects_do_not_count() -> None:
    table = selection_table(SCORES, ["cat", "duck"])
    assert table.header[:3] == ["visible", "targets", "ADD(-S)"]
    every, seen, hidden = table.rows
    assert every == ["all", "4", "0.500", "0.000", "0.750", "0.333", "0.000", "0.500"]
    assert seen[:3] == ["0.6 and more", "3", "0.667"] and seen[5] == "0.500"
    assert hidden[:3] == ["less than 0.6", "1", "0.000"]


def test_classes_without_targets_are_left_out() -> None:
    assert [row[0] for row in selection_table(SCORES, ["duck"]).rows] == ["all", "0.6 and more"]


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no target is a mug; there are cat, duck, glue"):
        selection_table(SCORES, ["cat", "mug"])
    with pytest.raises(FileNotFoundError, match="no finished run"):
        report_selection(tmp_path, "[cat]", "text")
    with pytest.raises(ValueError, match="format=html"):
        report_selection(tmp_path, "[cat]", "html")
