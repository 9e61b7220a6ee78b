import json
import os
from pathlib import Path
from typing import Any

import pytest

from hlp.reporting.metrics import summary_metrics
from hlp.reporting.paper import AD_BY_OBJECT, AD_MEAN, AD_STD
from hlp.reporting.tables import (
    Table,
    format_summary,
    objects_table,
    read_summary,
    report,
    runs_table,
    time_table,
    timing_words,
    total_table,
    votes_table,
    waterfall_tables,
)


def recall(value: float) -> dict[str, Any]:
    return {"recall": value, "ci95": [value - 0.1, value + 0.1], "mean_object": value / 2}


def quality(good: float | None, votes: float) -> dict[str, Any]:
    shares = ("good", "good_weight", "by_object", "good_by_object")
    values = [None if good is None else good + 0.1 * i for i in range(4)]
    return {**dict(zip(shares, values, strict=True)), "votes": votes}


def summary(names: tuple[str, ...] = ("cat", "ape")) -> dict[str, Any]:
    metrics = {"add": 0.5, "5cm5deg": 0.25, "iou50": 0.75}
    each = {key: {"recall": value} for key, value in metrics.items()}
    return {
        "targets": 8,
        "metrics": {key: recall(value) for key, value in metrics.items()},
        "per_object": {name: {"targets": 4, **each} for name in names},
        "median_errors": {"found": 7, "add_mm": 3.5},
        "bop": {"vsd": None, "mssd": 0.6},
        "timing_ms": {
            "total": {"median": 480.0, "p95": 700.0},
            "voting": {"median": 2.34, "p95": None},
        },
        "waterfall": {
            "total": {"correct": 5, "no_window": 0, "few_votes": 1, "ranking": 2},
            "per_object": {
                "cat": {"correct": 3, "no_window": 0, "few_votes": 1, "ranking": 0},
                "ape": {"correct": 2, "no_window": 0, "few_votes": 0, "ranking": 2},
            },
            "per_visibility": {
                "0.6-1": {"correct": 5, "no_window": 0, "few_votes": 1, "ranking": 2}
            },
        },
        "votes": {
            "total": quality(0.25, 1200.0),
            "per_object": {
                "cat": quality(0.125, 1000.4),
                "ape": quality(None, 0.0),
            },
        },
    }


def older_summary() -> dict[str, Any]:
    """As runs wrote it before misses had causes and votes were kept."""
    older = {**summary(), "waterfall": {"correct": 6, "no_region": 2}}
    del older["votes"]
    return older


def test_paper_figures_have_the_printed_mean_and_deviation() -> None:
    """What Table 1 prints below its fifteen objects."""
    values = list(AD_BY_OBJECT.values())
    mean = sum(values) / len(values)
    variance = sum((value - mean) ** 2 for value in values) / len(values)
    assert len(values) == 15
    assert mean == pytest.approx(AD_MEAN, abs=5e-4)
    assert variance**0.5 == pytest.approx(AD_STD, abs=5e-4)


def test_objects_table_has_the_papers_figures_beside_ours() -> None:
    table = objects_table(summary())
    assert table.header == ["object", "targets", "AD", "5cm5deg", "IoU.5", "paper AD"]
    assert list(table.rows) == [
        ["cat", "4", "0.500", "0.250", "0.750", "0.979"],
        ["ape", "4", "0.500", "0.250", "0.750", "0.970"],
        ["mean of objects", "8", "0.250", "0.125", "0.375", "0.974"],
        ["all targets", "8", "0.500", "0.250", "0.750", ""],
        ["  95 % interval", "", "0.400-0.600", "0.150-0.350", "0.650-0.850", ""],
    ]


def test_paper_is_left_out_where_it_says_nothing() -> None:
    assert "paper AD" not in objects_table(summary(("bracket", "cone"))).header
    assert "paper AD" not in objects_table(summary(("duck", "cone"))).header  # another duck


def test_time_table_ends_with_the_total() -> None:
    assert list(time_table(summary()).rows) == [["voting", "2.3", ""], ["total", "480", "700"]]


def test_where_targets_ended_in_all_per_object_and_per_visible_fraction() -> None:
    assert list(total_table(summary()).rows) == [
        ["correct", "5", "0.625"],
        ["no window", "0", "0.000"],
        ["few votes", "1", "0.125"],
        ["ranking", "2", "0.250"],
    ]
    objects, visibility = waterfall_tables(summary())
    assert objects.header == ["object", "targets", "correct", "few votes", "ranking"]
    assert list(objects.rows) == [
        ["cat", "4", "3", "1", "0"],
        ["ape", "4", "2", "0", "2"],
        ["all", "8", "5", "1", "2"],
    ]
    assert visibility.header[0] == "visible fraction"
    assert list(visibility.rows) == [["0.6-1", "8", "5", "1", "2"], ["all", "8", "5", "1", "2"]]


def test_votes_table_has_their_number_and_the_share_of_good_ones() -> None:
    assert list(votes_table(summary()).rows) == [
        ["cat", "1000", "0.125", "0.225", "0.325", "0.425"],
        ["ape", "0.0", "", "", "", ""],
        ["all", "1200", "0.250", "0.350", "0.450", "0.550"],
    ]


def test_report_tells_the_waterfall_and_draws_it(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps(summary()))
    text = report(tmp_path, "text")
    for table in (*waterfall_tables(summary()), votes_table(summary())):
        assert table.text() in text
    assert str(tmp_path / "waterfall.png") in text
    assert (tmp_path / "waterfall.png").is_file()
    assert (tmp_path / "waterfall.svg").is_file()


def test_summaries_of_before_there_were_causes_are_still_read(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps(older_summary()))
    text = report(tmp_path, "text")
    assert list(total_table(older_summary()).rows)[1] == ["no region", "2", "0.250"]
    assert total_table(older_summary()).text() in text
    assert not list(tmp_path.glob("waterfall.*"))


def test_text_is_aligned_and_markdown_is_a_table() -> None:
    table = Table(["object", "AD"], [["cat", "0.5"], ["holepuncher", "1"]])
    assert table.text() == (
        "object        AD\n"
        "----------------\n"
        "cat          0.5\n"
        "holepuncher    1"
    )  # fmt: skip
    assert table.markdown() == (
        "| object | AD |\n| --- | ---: |\n| cat | 0.5 |\n| holepuncher | 1 |"
    )


def test_report_lists_runs_oldest_first_then_side_by_side(tmp_path: Path) -> None:
    for age, name in enumerate(("late", "early")):
        path = tmp_path / name / "summary.json"
        path.parent.mkdir()
        path.write_text(json.dumps(summary()))
        os.utime(path, (1000 - age, 1000 - age))
    text = report(tmp_path, "text")
    assert text.index(str(tmp_path / "early")) < text.index(str(tmp_path / "late"))
    assert text.endswith(
        runs_table({str(tmp_path / each): summary() for each in ("early", "late")}).text()
    )
    assert "## All runs" in report(tmp_path, "markdown")
    assert "All runs" not in report(tmp_path / "late", "text")
    assert format_summary(summary()) in report(tmp_path / "late", "text")


def test_report_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=str(tmp_path)):
        report(tmp_path, "text")
    with pytest.raises(ValueError, match="format=html"):
        report(tmp_path, "html")
    (tmp_path / "summary.json").write_text('{"targets": 3')
    with pytest.raises(ValueError, match=r"summary\.json is no JSON"):
        read_summary(tmp_path / "summary.json")
    (tmp_path / "summary.json").write_text('{"targets": 3}')
    with pytest.raises(ValueError, match="it lacks metrics"):
        read_summary(tmp_path / "summary.json")


def test_metrics_bear_the_names_that_mlflow_takes() -> None:
    flat = summary_metrics(summary())
    assert flat["add/recall"] == 0.5
    assert flat["add/recall_cat"] == 0.5
    assert flat["pose_5cm5deg/recall_ci95_low"] == pytest.approx(0.15)
    assert flat["box_iou50/mean_object"] == 0.375
    assert flat["time_ms/total"] == 480.0
    assert flat["time_ms/voting_p95"] is None
    assert flat["waterfall/correct"] == 5
    assert flat["waterfall/few_votes"] == 1
    assert flat["votes/good"] == 0.25
    assert flat["votes/good_weight"] == 0.35
    assert flat["votes/good_by_object_cat"] == pytest.approx(0.425)
    assert flat["votes/good_cat"] == 0.125
    assert flat["votes/good_ape"] is None
    assert flat["median_errors/add_mm"] == 3.5
    assert flat["bop/vsd"] is None
    assert flat["targets"] == 8


def test_csv_and_latex_keep_every_cell() -> None:
    table = Table(["a_b", "95 %"], [["{5°, 5 mm}", "1,5"], ["θ & τ", ""]])
    assert table.csv() == 'a_b,95 %\n"{5°, 5 mm}","1,5"\nθ & τ,'
    assert table.latex().split("\n") == [
        r"\begin{tabular}{lr}",
        r"a\_b & 95 \% \\ \hline",
        r"\{5$^\circ$, 5 mm\} & 1,5 \\",
        r"$\theta$ \& $\tau$ &  \\",
        r"\end{tabular}",
    ]


def test_a_line_says_how_the_times_were_measured() -> None:
    timing = {"frames": 20, "objects": 31, "reused_stages": [], "first_use_seconds": 7.24}
    own = timing_words({"timing": timing})
    assert own.startswith("Times: measured by this run on 20 frames.")
    assert "7.2 s (not included)" in own
    again = timing | {"reused_stages": ["regions", "poses"], "frames": 1, "first_use_seconds": None}
    assert timing_words({"timing": again}) == (
        "Times: the results of regions, poses were reused; measured again on 1 frame."
    )
    assert timing_words({}) == ""
    shown = format_summary(summary() | {"timing": again})
    assert shown.index("ms per target") < shown.index("on 1 frame") < shown.index("targets ended")
