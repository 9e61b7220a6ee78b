import json
import os
from pathlib import Path

import pytest

from hlp.commands.report import report
from hlp.errors import DataError, MissingFileError
from hlp.records import TargetScore
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.experiments import describe_reports
from hlp.reporting.mlflow.tracking import MlflowSettings, track_run
from hlp.reporting.report import (
    describe_named,
    describe_outputs,
    report_runs,
    report_selection,
    run_list,
    scores_file,
    selection_table,
)
from hlp.reporting.summary_tables import format_summary
from hlp.results.poses_file import write_scores
from hlp.results.recalls import read_summary
from table_text import unpadded
from written_results import scored, summary, write_run, write_sweep


def test_report_lists_runs_oldest_first(tmp_path: Path) -> None:
    for age, name in enumerate(("late", "early")):
        path = tmp_path / name / "summary.json"
        path.parent.mkdir()
        path.write_text(json.dumps(summary()))
        os.utime(path, (1000 - age, 1000 - age))
    lines = run_list(tmp_path).text()
    text = report_runs(tmp_path, "text")
    assert lines in text and "targets ended as" not in text
    text = report_runs(tmp_path, "text", details=True)
    assert text.index(str(tmp_path / "early")) < text.index(str(tmp_path / "late"))
    assert text.endswith(lines)
    assert "## All runs" in report_runs(tmp_path, "markdown")
    assert "All runs" not in report_runs(tmp_path / "late", "text")
    assert format_summary(summary()) in report_runs(tmp_path / "late", "text")


def repeat(folder: Path, *right: bool, vsd: float = float("nan")) -> str:
    """An output folder whose targets are right or wrong by every metric but BOP's."""
    folder.mkdir()
    scores = [
        TargetScore(1, image, 6, True, 0.75, 0.01, 0.1, 0.01, 0.9, *[verdict] * 3, 0.5, 0.7, vsd)
        for image, verdict in enumerate(right)
    ]
    write_scores(folder / "scores.csv", scores, {6: "cat"})
    return str(folder)


def test_what_is_broken_or_of_another_version_costs_itself(tmp_path, caplog):
    write_run(tmp_path / "a", "demo", summary())
    write_run(tmp_path / "b", "demo", {})
    assert str(tmp_path / "a") in report_runs(tmp_path, "text")
    assert describe_reports(tmp_path, "text") == ""
    assert f"left out: {tmp_path / 'b' / 'summary.json'} is not a summary" in caplog.text
    with pytest.raises(DataError, match=r"is not a summary of a run .*targets is missing"):
        report_runs(tmp_path / "b", "text")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("metrics", "x", "metrics is 'x': it must be a mapping"),
        (
            "metrics",
            {"add": {"recall": 0.5, "ci95": [0, 1], "mean_object": 0}},
            "it lacks 5cm5deg, iou50",
        ),
        ("targets", "many", "targets is 'many': it must be a whole number"),
        ("per_object", {"cat": {"targets": 3}}, "it lacks 5cm5deg, add, iou50"),
        ("bop", {"ar": 1.5}, "bop.vsd is missing"),
    ],
)
def test_a_summary_of_other_types_is_named(tmp_path, key, value, said):
    write_run(tmp_path / "a", "demo", summary() | {key: value})
    with pytest.raises(DataError) as error:
        read_summary(tmp_path / "a" / "summary.json")
    assert said in str(error.value)
    assert [row[1] for row in run_list(tmp_path).rows] == ["broken"]


def test_a_terminal_obeys_no_name_in_a_run(tmp_path, capsys):
    write_run(tmp_path / "a", "demo", summary(("cat\x1b]0;x\x07", "ape")))
    report([f"output={tmp_path}"])
    assert "cat\ufffd]0;x\ufffd" in capsys.readouterr().out


def test_of_three_runs_mean_and_standard_deviation_are_told(tmp_path: Path) -> None:
    names = [
        repeat(tmp_path / "a", True, True, True, False, vsd=0.9),
        repeat(tmp_path / "b", True, True, False, False, vsd=0.6),
        repeat(tmp_path / "c", True, True, True, True, vsd=0.3),
    ]
    told = describe_named(f"[{', '.join(names)}]", "sqlite:///none.db", "markdown")
    lines = [unpadded(line) for line in told.splitlines()]
    assert lines[0] == "| run | targets | ADD(-S) | 5cm5deg | IoU.5 | AR |"
    assert lines[2] == f"| {names[0]} | 4 | 0.750 | 0.750 | 0.750 | 0.700 |"
    assert lines[-2:] == [
        "| mean | | 0.750 | 0.750 | 0.750 | 0.600 |",
        "| standard deviation | | 0.2500 | 0.2500 | 0.2500 | 0.1000 |",
    ]


def test_runs_of_other_targets_are_said_to_be(tmp_path: Path) -> None:
    names = [repeat(tmp_path / str(i), *[True] * (1 + i)) for i in range(3)]
    told = describe_named(f"[{','.join(names)}]", "sqlite:///none.db", "text")
    assert "mean" in told and "nan" not in told  # BOP's recalls were not computed
    assert told.endswith("The runs were not asked for the same targets.")


def test_scores_are_found_by_folder_and_by_run(tmp_path: Path) -> None:
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    path = tmp_path / "out" / "scores.csv"
    path.parent.mkdir()
    with pytest.raises(FileNotFoundError, match="no finished run"):
        scores_file(str(path.parent), uri)
    with pytest.raises(FileNotFoundError, match="no MLflow database"):
        scores_file("nowhere", uri)
    assert not (tmp_path / "mlflow.db").exists()
    path.write_text("scene_id\n")
    assert scores_file(str(path.parent), uri) == path
    with track_run(MlflowSettings(uri=uri), "scored", {}) as tracker:
        tracker.log_artifact(path)
    assert scores_file(tracker.run_id, uri).read_text() == "scene_id\n"
    with pytest.raises(FileNotFoundError, match="no folder nowhere"):
        scores_file("nowhere", uri)


def test_every_run_and_sweep_has_its_line(tmp_path: Path) -> None:
    write_run(tmp_path / "demo" / "a", "demo", scored(0.75, 40.0, {"cat": 0.75}))
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1,2"])
    write_run(sweep / "0", "demo", scored(0.5, 40.0, {"cat": 0.5}))
    (sweep / "1" / ".hydra").mkdir(parents=True)
    (write_run(tmp_path / "demo" / "b", "demo", {}) / "summary.json").write_text("{")
    rows = {row[0]: list(row[1:]) for row in run_list(tmp_path).rows}
    assert rows.pop("demo/a") == ["finished", "20", "0.750", "0.650-0.790", "0.550", "40"]
    assert {name: row[0] for name, row in rows.items()} == {
        "demo/b": "broken",
        "sweep": "1/2 runs",
        "sweep/0": "finished",
        "sweep/1": "unfinished",
    }
    assert "best run. 5 runs below" in describe_outputs(tmp_path, "text")


def test_a_sweep_has_the_figures_of_its_best_run(tmp_path: Path) -> None:
    sweep = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1,2,3"])
    for run, (recall, ms) in enumerate([(0.5, 40.0), (0.8, 90.0), (0.8, 60.0)]):
        write_run(sweep / str(run), "demo", scored(recall, ms, {"cat": recall}))
    (row,) = (row for row in run_list(tmp_path).rows if row[0] == "sweep")
    assert list(row[1:]) == ["3/3 runs", "20", "0.800", "0.700-0.840", "0.600", "90"]


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


def test_an_empty_folder_is_named_with_what_makes_a_run(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=str(tmp_path)):
        report_runs(tmp_path, "text")
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
    assert every == ["all", "4", "0.500", "0.000", "0.750"]
    assert seen[:3] == ["0.6 and more", "3", "0.667"]
    assert hidden[:3] == ["less than 0.6", "1", "0.000"]


def test_classes_without_targets_are_left_out() -> None:
    assert [row[0] for row in selection_table(SCORES, ["duck"]).rows] == ["all", "0.6 and more"]


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no target is a mug; there are cat, duck, glue"):
        selection_table(SCORES, ["cat", "mug"])
    with pytest.raises(FileNotFoundError, match="no finished run"):
        report_selection(tmp_path, "[cat]", "text")
