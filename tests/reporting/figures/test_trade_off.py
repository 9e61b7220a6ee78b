import csv
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hlp.reporting.figures.trade_off import FRONT, draw_trade_off, pareto_front, recall_by_time
from hlp.reporting.report import report_runs
from hlp.reporting.results import read_results
from written_results import write_run, write_sweep


def summary(recall: float, ms: float) -> dict[str, Any]:
    metric = {"recall": recall, "ci95": [recall - 0.1, recall + 0.05], "mean_object": recall}
    metrics = {key: metric for key in ("add", "5cm5deg", "iou50")}
    return {
        "targets": 50,
        "metrics": metrics,
        "per_object": {"cat": {"targets": 50, **metrics}},
        "timing_ms": {"total": {"median": ms, "p95": 2 * ms}},
        "waterfall": {"correct": 50},
    }


def sweep(folder: Path, swept: list[str], runs: list[tuple[list[str], float, float]]) -> Path:
    """Runs given by their overrides, recall and median ms."""
    write_sweep(folder / "sweep", swept, [])
    for number, (overrides, recall, ms) in enumerate(runs):
        write_run(folder / "sweep" / str(number), "x", summary(recall, ms), ["seed=1", *overrides])
    return folder / "sweep"


def drawn(folder: Path) -> Any:
    """The axes of the figure of a sweep."""
    found = read_results(folder)
    (ax,) = recall_by_time(found.results, found.swept).axes
    return ax


BUDGETS = [
    (["refinement.budget_ms=0"], 0.9, 300.0),
    (["refinement.budget_ms=20"], 0.7, 120.0),
    (["refinement.budget_ms=80"], 0.8, 180.0),
]


def test_budgets_are_one_line_in_the_order_of_their_time(tmp_path: Path) -> None:
    ax = drawn(sweep(tmp_path, ["refinement.budget_ms"], BUDGETS))
    (line,) = [each for each in ax.get_lines() if len(each.get_xdata()) == 3][:1]
    assert list(line.get_xdata()) == [120.0, 180.0, 300.0]
    assert list(line.get_ydata()) == [0.7, 0.8, 0.9]
    assert [text.get_text() for text in ax.texts] == ["20 ms", "80 ms", "no limit"]
    assert legend(ax) == [FRONT]


def legend(ax: Any) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_the_front_is_a_step_and_what_it_beats_is_hollow(tmp_path: Path) -> None:
    beaten = (["refinement.budget_ms=40"], 0.75, 200.0)  # slower than 80 ms, and worse
    folder = sweep(tmp_path, ["refinement.budget_ms"], [*BUDGETS, beaten])
    ax = drawn(folder)
    (front,) = [each for each in ax.get_lines() if each.get_label() == FRONT]
    assert list(front.get_xdata())[:3] == [120.0, 180.0, 300.0]
    assert list(front.get_ydata()) == [0.7, 0.8, 0.9, 0.9]
    assert front.get_drawstyle() == "steps-post"
    hollow = [each for each in ax.get_lines() if each.get_markerfacecolor() == "white"]
    assert [(*each.get_xdata(), *each.get_ydata()) for each in hollow] == [(200.0, 0.75)]
    draw_trade_off(folder)
    with (folder / "recall_by_time.csv").open(newline="") as stream:
        assert [row["pareto"] for row in csv.DictReader(stream)] == ["1", "1", "1", "0"]


def test_labels_of_runs_that_nearly_coincide_are_stacked(tmp_path: Path) -> None:
    near = [
        *BUDGETS,
        (["refinement.budget_ms=160"], 0.85, 302.0),
        (["refinement.budget_ms=320"], 0.9, 310.0),
    ]
    ax = drawn(sweep(tmp_path, ["refinement.budget_ms"], near))
    assert [text.get_text() for text in ax.texts] == ["20 ms", "80 ms", "no limit\n160 ms\n320 ms"]
    assert ax.texts[-1].xy == (300.0, 0.85)  # below the lowest of them
    assert ax.get_xlim()[1] > 330.0


def test_what_else_was_swept_makes_lines_of_its_own(tmp_path: Path) -> None:
    runs = [
        ([*budget, f"voting.hypotheses={count}"], recall, ms)
        for count in (4, 24)
        for budget, recall, ms in BUDGETS
    ]
    keys = ["refinement.budget_ms", "voting.hypotheses"]
    ax = drawn(sweep(tmp_path, keys, runs))
    assert sorted(legend(ax)) == sorted([FRONT, "hypotheses 4", "hypotheses 24"])
    assert len(ax.containers) == 2


def test_files_are_written_and_the_report_names_them(tmp_path: Path) -> None:
    folder = sweep(tmp_path, ["refinement.budget_ms"], BUDGETS)
    written = draw_trade_off(folder)
    assert [path.name for path in written] == [f"recall_by_time.{e}" for e in ("csv", "png", "svg")]
    with written[0].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["add_recall"] for row in rows] == ["0.9", "0.7", "0.8"]
    assert cv2.imread(str(written[1])).shape[1] > 400
    assert [row["refinement.budget_ms"] for row in rows] == ["0", "20", "80"]
    assert (rows[0]["targets"], rows[0]["median_ms"], rows[0]["p95_ms"]) == ("50", "300.0", "600.0")
    assert [float(rows[0][key]) for key in ("ci95_low", "ci95_high")] == [0.8, 0.9 + 0.05]
    picture = written[2].read_bytes()
    said = report_runs(folder, "text")
    assert f"Written: {folder}" in " ".join(said.split())  # in lines of a terminal
    assert written[1].name in said
    assert written[2].read_bytes() == picture


def test_one_run_makes_no_picture(tmp_path: Path) -> None:
    assert draw_trade_off(sweep(tmp_path, ["refinement.budget_ms"], BUDGETS[:1])) == []
    assert not list(tmp_path.rglob("recall_by_time*"))


# Few values, so that many points are equal in one or both.
FEW = st.integers(0, 6)


def beaten(times: np.ndarray, recalls: np.ndarray) -> np.ndarray:
    """For every point: whether any other is as good in both, and better in one. The definition."""
    as_good = (times[None] <= times[:, None]) & (recalls[None] >= recalls[:, None])
    better = (times[None] < times[:, None]) | (recalls[None] > recalls[:, None])
    return (as_good & better).any(axis=1)


@given(st.lists(st.tuples(FEW, FEW), max_size=30))
def test_the_front_is_what_no_point_beats(points: list[tuple[int, int]]) -> None:
    times, recalls = np.array(points).reshape(-1, 2).T
    front = pareto_front(times.tolist(), recalls.tolist())
    assert sorted(front) == np.flatnonzero(~beaten(times, recalls)).tolist()
    assert [(times[i], recalls[i]) for i in front] == sorted((times[i], recalls[i]) for i in front)


def test_one_point_and_none() -> None:
    assert pareto_front([3.0], [0.5]) == [0]
    assert pareto_front([], []) == []
