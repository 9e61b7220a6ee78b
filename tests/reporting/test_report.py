import json
import os
from pathlib import Path

import pytest

from hlp.reporting.report import report_runs
from hlp.reporting.tables.summary_tables import (
    format_summary,
    runs_table,
    total_table,
    votes_table,
    waterfall_tables,
)
from hlp.results.summary_file import read_summary
from written_summary import older_summary, summary


def test_report_tells_the_waterfall_and_draws_it(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps(summary()))
    text = report_runs(tmp_path, "text")
    for table in (*waterfall_tables(summary()), votes_table(summary())):
        assert table.text() in text
    assert str(tmp_path / "waterfall.png") in text
    assert (tmp_path / "waterfall.png").is_file()
    assert (tmp_path / "waterfall.svg").is_file()


def test_summaries_of_before_there_were_causes_are_still_read(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps(older_summary()))
    text = report_runs(tmp_path, "text")
    assert list(total_table(older_summary()).rows)[1] == ["no region", "2", "0.250"]
    assert total_table(older_summary()).text() in text
    assert not list(tmp_path.glob("waterfall.*"))


def test_report_lists_runs_oldest_first_then_side_by_side(tmp_path: Path) -> None:
    for age, name in enumerate(("late", "early")):
        path = tmp_path / name / "summary.json"
        path.parent.mkdir()
        path.write_text(json.dumps(summary()))
        os.utime(path, (1000 - age, 1000 - age))
    lines = runs_table({each: summary() for each in ("early", "late")}).text()
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
    with pytest.raises(ValueError, match=r"summary\.json is no JSON"):
        read_summary(tmp_path / "summary.json")
    (tmp_path / "summary.json").write_text('{"targets": 3}')
    with pytest.raises(ValueError, match="it lacks metrics"):
        read_summary(tmp_path / "summary.json")
