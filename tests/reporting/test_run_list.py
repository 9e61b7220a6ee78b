from pathlib import Path

import pytest

from hlp.errors import MissingFileError
from hlp.records import TargetScore
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.report import describe_outputs, report_selection, run_list, selection_table
from written_results import scored, write_run, write_sweep


def test_every_run_and_sweep_has_its_line(tmp_path: Path) -> None:
    write_run(tmp_path / "demo" / "a", "demo", scored(0.75, 40.0, {"cat": 0.75}))
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1,2"])
    write_run(sweep / "0", "demo", scored(0.5, 40.0, {"cat": 0.5}))
    (sweep / "1" / ".hydra").mkdir(parents=True)
    broken = write_run(tmp_path / "demo" / "b", "demo", {})
    (broken / "summary.json").write_text("{")
    rows = {row[0]: list(row[1:]) for row in run_list(tmp_path).rows}
    assert rows.pop("demo/a") == ["finished", "20", "0.750", "0.65-0.79", "0.550", "40"]
    assert {name: row[0] for name, row in rows.items()} == {
        "demo/b": "broken",
        "sweep": "1/2 runs",
        "sweep/0": "finished",
        "sweep/1": "unfinished",
    }
    text = describe_outputs(tmp_path, "text")
    assert "best run. 5 runs below" in text


def test_a_sweep_has_the_figures_of_its_best_run(tmp_path: Path) -> None:
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1,2,3"])
    for run, (recall, ms) in enumerate([(0.5, 40.0), (0.8, 90.0), (0.8, 60.0)]):
        write_run(sweep / str(run), "demo", scored(recall, ms, {"cat": recall}))
    (row,) = (row for row in run_list(tmp_path).rows if row[0] == "sweep")
    assert list(row[1:]) == ["3/3 runs", "20", "0.800", "0.70-0.84", "0.600", "60"]


@pytest.mark.parametrize("broken", ["sweep.json", "0/summary.json", "0/manifest.json"])
def test_a_sweep_with_a_broken_file_is_said_to_be_broken(broken: str, tmp_path: Path) -> None:
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1,2"])
    for run in "01":
        write_run(sweep / run, "demo", scored(0.5, 40.0, {"cat": 0.5}))
    (sweep / broken).write_text("{")
    (row,) = (row for row in run_list(tmp_path).rows if row[0] == "sweep")
    assert row[1] == "broken" and not any(row[2:])


def test_the_list_fits_a_terminal_and_shows_the_ends_of_long_names(tmp_path: Path) -> None:
    folder = tmp_path / "linemod_bop_with_something_else"
    sweep = write_sweep(folder / "2026-11-22_07-15-52", ["seed"], ["seed=1,2"])
    for run in "01":
        write_run(sweep / run, "demo", scored(0.5, 12345.0, {"cat": 0.5}))
    lines = describe_outputs(tmp_path, "text").splitlines()[:-1]
    assert max(map(len, lines)) <= 80
    assert sum("…" in line and "_07-15-52" in line for line in lines) == 3
    assert "else/2026-11-22_07-15-52/0" in describe_outputs(tmp_path, "markdown")


def test_an_empty_folder_says_what_makes_a_run(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="`hlp run` makes one"):
        describe_outputs(tmp_path, "text")


def target(name: str, visible: float, right: bool, box: bool = True) -> ScoredTarget:
    score = TargetScore(1, 2, 3, True, visible, 0.001, 0.1, 0.001, 0.9, right, False, box)
    return ScoredTarget(name, score)


SCORES = [
    target("cat", 0.9, True),
    target("cat", 0.6, True),
    target("cat", 0.5, False),
    target("duck", 0.7, False, box=False),
    target("glue", 0.2, True),
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
