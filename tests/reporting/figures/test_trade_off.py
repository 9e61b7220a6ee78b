import csv
import json
from pathlib import Path

import cv2
import pytest

from hlp.reporting.figures.trade_off import draw_trade_off, read_arms, recall_by_time
from hlp.reporting.tables import report


def sweep(folder: Path, swept: list[str], arms: list[tuple[list[str], float, float]]) -> Path:
    """Arms given by their overrides, recall and median ms."""
    (folder / "sweep.json").write_text(json.dumps({"swept": swept}))
    for number, (overrides, recall, ms) in enumerate(arms):
        hydra = folder / str(number) / ".hydra"
        hydra.mkdir(parents=True)
        (hydra / "overrides.yaml").write_text(json.dumps(["seed=1", *overrides]))
        add = {"recall": recall, "ci95": [recall - 0.1, recall + 0.05]}
        total = {"median": ms, "p95": 2 * ms}
        summary = {"targets": 50, "metrics": {"add": add}, "timing_ms": {"total": total}}
        (folder / str(number) / "summary.json").write_text(json.dumps(summary))
    return folder


BUDGETS = [
    (["refinement.budget_ms=0"], 0.9, 300.0),
    (["refinement.budget_ms=20"], 0.7, 120.0),
    (["refinement.budget_ms=80"], 0.8, 180.0),
]


def test_arms_are_read_with_what_was_swept_and_reached(tmp_path: Path) -> None:
    (first, *_) = arms = read_arms(sweep(tmp_path, ["refinement.budget_ms"], BUDGETS))
    assert [each.values["refinement.budget_ms"] for each in arms] == ["0", "20", "80"]
    assert (first.targets, first.recall, first.median_ms, first.p95_ms) == (50, 0.9, 300.0, 600.0)
    assert first.interval == pytest.approx((0.8, 0.95))


def test_budgets_are_one_line_in_the_order_of_their_time(tmp_path: Path) -> None:
    (ax,) = recall_by_time(read_arms(sweep(tmp_path, ["refinement.budget_ms"], BUDGETS))).axes
    (line,) = [each for each in ax.get_lines() if len(each.get_xdata()) == 3][:1]
    assert list(line.get_xdata()) == [120.0, 180.0, 300.0]
    assert list(line.get_ydata()) == [0.7, 0.8, 0.9]
    assert [text.get_text() for text in ax.texts] == ["20 ms", "80 ms", "no limit"]
    assert ax.get_legend() is None


def test_labels_of_arms_that_nearly_coincide_are_stacked(tmp_path: Path) -> None:
    near = [
        *BUDGETS,
        (["refinement.budget_ms=160"], 0.85, 302.0),
        (["refinement.budget_ms=320"], 0.9, 310.0),
    ]
    (ax,) = recall_by_time(read_arms(sweep(tmp_path, ["refinement.budget_ms"], near))).axes
    assert [text.get_text() for text in ax.texts] == ["20 ms", "80 ms", "no limit\n160 ms\n320 ms"]
    assert ax.texts[-1].xy == (300.0, 0.85)  # below the lowest of them
    assert ax.get_xlim()[1] > 330.0


def test_what_else_was_swept_makes_lines_of_its_own(tmp_path: Path) -> None:
    arms = [
        ([*budget, f"voting.hypotheses={count}"], recall, ms)
        for count in (4, 24)
        for budget, recall, ms in BUDGETS
    ]
    keys = ["refinement.budget_ms", "voting.hypotheses"]
    (ax,) = recall_by_time(read_arms(sweep(tmp_path, keys, arms))).axes
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == ["hypotheses 4", "hypotheses 24"]
    assert len(ax.containers) == 2


def test_files_are_written_and_the_report_names_them(tmp_path: Path) -> None:
    folder = sweep(tmp_path, ["refinement.budget_ms"], BUDGETS)
    written = draw_trade_off(folder)
    assert [path.name for path in written] == [f"recall_by_time.{e}" for e in ("csv", "png", "svg")]
    with written[0].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["add_recall"] for row in rows] == ["0.9", "0.7", "0.8"]
    assert cv2.imread(str(written[1])).shape[1] > 400
    picture = written[2].read_bytes()
    for path in folder.glob("*/summary.json"):
        summary = json.loads(path.read_text())
        empty = {"recall": 0.5, "ci95": [0.4, 0.6], "mean_object": 0.5}
        summary["metrics"] |= {"5cm5deg": empty, "iou50": empty}
        summary["metrics"]["add"]["mean_object"] = 0.5
        cat = {"targets": 50, **summary["metrics"]}
        summary |= {"per_object": {"cat": cat}, "waterfall": {"correct": 50}}
        path.write_text(json.dumps(summary))
    assert f"Drawn: {written[1]}" in report(folder, "text")
    assert written[2].read_bytes() == picture


def test_one_arm_makes_no_picture(tmp_path: Path) -> None:
    assert draw_trade_off(sweep(tmp_path, ["refinement.budget_ms"], BUDGETS[:1])) == []
    assert not list(tmp_path.glob("recall_by_time*"))
