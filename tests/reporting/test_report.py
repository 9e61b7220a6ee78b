import json
import os
from pathlib import Path

import pytest

from hlp.records import TargetScore
from hlp.reporting.mlflow.tracking import MlflowSettings, track_run
from hlp.reporting.report import describe_named, report_runs, scores_file
from hlp.reporting.summary_tables import (
    format_summary,
    runs_table,
    total_table,
)
from hlp.results.poses_file import write_scores
from hlp.results.summary_file import read_summary
from table_text import unpadded
from written_summary import older_summary, summary


def test_summaries_of_before_there_were_causes_are_still_read(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps(older_summary()))
    text = report_runs(tmp_path, "text")
    assert list(total_table(older_summary()).rows)[1] == ["no region", "2", "0.250"]
    assert total_table(older_summary()).text() in text


def test_report_lists_runs_oldest_first_then_side_by_side(tmp_path: Path) -> None:
    for age, name in enumerate(("late", "early")):
        path = tmp_path / name / "summary.json"
        path.parent.mkdir()
        path.write_text(json.dumps(summary()))
        os.utime(path, (1000 - age, 1000 - age))
    lines = runs_table({name: summary() for name in ("early", "late")}).text()
    text = report_runs(tmp_path, "text")
    assert lines in text and "targets ended as" not in text
    text = report_runs(tmp_path, "text", details=True)
    assert text.index(str(tmp_path / "early")) < text.index(str(tmp_path / "late"))
    assert text.endswith(lines)
    assert "## All runs" in report_runs(tmp_path, "markdown")
    assert "All runs" not in report_runs(tmp_path / "late", "text")
    assert format_summary(summary()) in report_runs(tmp_path / "late", "text")


def test_report_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=str(tmp_path)):
        report_runs(tmp_path, "text")
    with pytest.raises(ValueError, match="format=html"):
        report_runs(tmp_path, "html")
    (tmp_path / "summary.json").write_text('{"targets": 3')
    with pytest.raises(ValueError, match=r"summary\.json is not JSON"):
        read_summary(tmp_path / "summary.json")
    (tmp_path / "summary.json").write_text('{"targets": 3}')
    with pytest.raises(ValueError, match="it lacks metrics"):
        read_summary(tmp_path / "summary.json")


def repeat(folder: Path, *right: bool, vsd: float = float("nan")) -> str:
    """An output folder whose targets are right or wrong by every metric but BOP's."""
    folder.mkdir()
    scores = [
        TargetScore(1, image, 6, True, 0.75, 0.01, 0.1, 0.01, 0.9, *[verdict] * 3, 0.5, 0.7, vsd)
        for image, verdict in enumerate(right)
    ]
    write_scores(folder / "scores.csv", scores, {6: "cat"})
    return str(folder)


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
