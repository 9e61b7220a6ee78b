"""Recall against time (sweeps, trials, their Pareto front), and the charts of a run's page."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hlp.records import TargetScore
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.figures import charts
from hlp.reporting.figures.bars import object_bars
from hlp.reporting.figures.charts import FRONT, pareto_front, recall_by_time, search_points
from hlp.reporting.report import report_runs
from hlp.reporting.summary_tables import ADD_BY_OBJECT
from hlp.reporting.sweep_report import write_sweep as write_files
from hlp.reporting.sweeps import read_sweeps
from written_results import scored, summary, write_run, write_sweep


def sweep(folder: Path, swept: list[str], runs: list[tuple[list[str], float, float]]) -> Path:
    """Runs given by their overrides, recall and median ms."""
    write_sweep(folder / "sweep", swept, [])
    for number, (overrides, recall, ms) in enumerate(runs):
        summary = scored(recall, ms, {"cat": recall})
        write_run(folder / "sweep" / str(number), "x", summary, ["seed=1", *overrides])
    return folder / "sweep"


RUNS = [
    (["refinement.budget_ms=null"], 0.9, 300.0),
    (["refinement.budget_ms=20"], 0.7, 120.0),
    (["refinement.budget_ms=80"], 0.8, 180.0),
    (["refinement.budget_ms=40"], 0.75, 200.0),  # slower than 80 ms, and worse
]


def test_the_front_is_a_step_and_what_it_beats_is_hollow(tmp_path: Path) -> None:
    folder = sweep(tmp_path, ["refinement.budget_ms"], RUNS)
    (found,) = read_sweeps(folder)
    figure = recall_by_time(found.results, found.keys)
    (ax,) = figure.axes
    (front,) = [curve for curve in ax.get_lines() if curve.get_label() == FRONT]
    assert list(front.get_xdata())[:3] == [120.0, 180.0, 300.0]
    assert list(front.get_ydata()) == [0.7, 0.8, 0.9, 0.9]
    assert front.get_drawstyle() == "steps-post"
    hollow = [line for line in ax.get_lines() if line.get_markerfacecolor() == "white"]
    assert [(*line.get_xdata(), *line.get_ydata()) for line in hollow] == [(200.0, 0.75)]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == [FRONT, *(f"budget_ms {value}" for value in ("null", "20", "80", "40"))]


def test_files_are_written_and_the_report_names_them(tmp_path: Path) -> None:
    folder = sweep(tmp_path, ["refinement.budget_ms"], RUNS)
    (found,) = read_sweeps(folder)
    written = write_files(folder, found)[-2:]
    assert [path.name for path in written] == [f"recall_by_time.{e}" for e in ("png", "svg")]
    assert cv2.imread(str(written[0])).shape[1] > 400
    picture = written[1].read_bytes()
    said = report_runs(folder, "text")
    assert f"Written: {folder}" in " ".join(said.split())  # in lines of a terminal
    assert written[0].name in said
    assert written[1].read_bytes() == picture
    alone = write_files(folder, replace(found, runs=found.runs[:1]))
    assert not {path.name for path in written} & {path.name for path in alone}


# Few values, so that many points are equal in one or both.
FEW = st.integers(0, 6)


def beaten(points: np.ndarray) -> np.ndarray:
    """For every point: whether any other is as good in both, and better in one. The definition."""
    times, recalls = points.T
    as_good = (times[None] <= times[:, None]) & (recalls[None] >= recalls[:, None])
    better = (times[None] < times[:, None]) | (recalls[None] > recalls[:, None])
    return (as_good & better).any(axis=1)


@given(st.lists(st.tuples(FEW, FEW), max_size=30))
def test_the_front_is_what_no_point_beats(points: list[tuple[int, int]]) -> None:
    front = pareto_front(points)
    assert sorted(front) == np.flatnonzero(~beaten(np.array(points).reshape(-1, 2))).tolist()
    assert [points[i] for i in front] == sorted(points[i] for i in front)


def trial(number: int, recall: float | None, ms: float | None) -> dict[str, Any]:
    error = "no particles" if recall is None else None
    found = {"recall": recall, "time_ms": ms, "error": error}
    return {"trial": number, "values": {"n": number}, **found}


def result(*trials: dict[str, Any], best: int | None) -> dict[str, Any]:
    chosen = next((trial for trial in trials if trial["trial"] == best), None)
    return {"space": "refinement", "limit_ms": 200.0, "best": chosen, "trials": [*trials]}


TRIALS = (trial(0, 0.8, 150.0), trial(1, None, None), trial(2, 0.9, 190.0), trial(3, 0.95, 260.0))


def test_limit_front_and_best_trial_are_drawn_and_failures_are_not() -> None:
    (ax,) = search_points(result(*TRIALS, best=2)).axes
    lines = {str(line.get_label()): line for line in ax.get_lines()}
    assert list(lines["limit 200 ms"].get_xdata()) == [200.0, 200.0]
    assert list(lines[FRONT].get_ydata()) == [0.8, 0.9, 0.95, 0.95]
    (star,) = [line for words, line in lines.items() if words.endswith("trial 2")]
    assert (*star.get_xdata(), *star.get_ydata()) == (190.0, 0.9)
    (points,) = ax.collections
    assert points.get_offsets().tolist() == [[150.0, 0.8], [190.0, 0.9], [260.0, 0.95]]
    colors = [tuple(facecolor) for facecolor in points.get_facecolors()]
    assert colors[0] == colors[1] != colors[2]  # over the limit
    (ax,) = search_points(result(TRIALS[3], best=None)).axes
    assert not [line for line in ax.get_lines() if "best" in str(line.get_label())]


def target(right: bool, **changes: Any) -> ScoredTarget:
    """A target of the cat: 2 mm and 6 degrees off, half visible, unless changed."""
    score = TargetScore(
        1, 2, 6, True, 0.55, 0.002, np.radians(6.0), 0.002, 0.9, right, right, right
    )
    return ScoredTarget("cat", replace(score, **changes))


def bars(figure: Any) -> tuple[list[str], list[float], list[str]]:
    """Rows of a figure of bars: their names, lengths and words."""
    (ax,) = figure.axes
    names = [label.get_text() for label in ax.get_yticklabels()]
    points = [x for line in ax.lines if line.get_marker() == "o" for x in line.get_xdata()]
    lengths = [bar.get_width() for bar in ax.patches] or points
    return names, lengths, [text.get_text() for text in ax.texts]


def test_objects_have_bars_with_intervals_and_the_papers_recall() -> None:
    written = summary(("cat", "ape"))
    written["per_object"]["cat"]["add"] = {"recall": 0.75, "ci95": [0.6, 0.8]}
    figure = object_bars(written)
    assert bars(figure) == (["cat", "ape"], [0.75, 0.5], ["0.750", "0.500"])
    lines = {str(line.get_label()): line.get_xdata() for line in figure.axes[0].lines}
    assert list(lines["paper"]) == [ADD_BY_OBJECT["cat"], ADD_BY_OBJECT["ape"]]
    assert [0.6, 0.8] in [list(ends) for ends in lines.values()]
    unknown = object_bars(summary(("mug",)))
    assert "paper" not in {line.get_label() for line in unknown.axes[0].lines}


def test_recall_by_visible_fraction_names_the_number_of_targets() -> None:
    targets = [target(True), target(False), target(True, visible_fraction=1.0)]
    figure = charts.visibility_bars([*targets, target(True, visible_fraction=math.nan)])
    assert bars(figure) == (["0.5 to 0.6 (2)", "0.9 to 1.0 (1)"], [0.5, 1.0], ["0.500", "1.000"])
    assert charts.visibility_bars([target(True, visible_fraction=math.nan)]) is None


def test_times_are_medians_with_the_95th_percentile() -> None:
    written = summary()
    figure = charts.timing_bars(written)
    assert bars(figure) == (["total", "voting"], [480.0, 2.34], ["480 (700)", "2.3"])
    written["timing_ms"] = {"total": {"median": None, "p95": None}}
    assert charts.timing_bars(written) is None


def test_the_curve_is_the_share_of_targets_below_each_threshold() -> None:
    targets = [target(True), target(False, add_error=0.012), target(False, add_error=math.inf)]
    figure = charts.ad_curve(targets, {"cat": 100.0})
    assert figure is not None
    *_, everything = figure.axes[0].lines
    shares = dict(zip(everything.get_xdata().round(6), everything.get_ydata(), strict=True))
    assert (shares[2.0], shares[2.25], shares[20.0]) == (0.0, 1 / 3, 2 / 3)
    assert charts.ad_curve(targets, {"duck": 100.0}) is None


def test_bops_curves_are_the_shares_below_each_threshold() -> None:
    """Errors of 12 and 47 % of the diameter, and of 3 and 60 px."""
    targets = [
        target(True, mssd_recall=0.8, mspd_recall=1.0),
        target(False, mssd_recall=0.1, mspd_recall=0.0),
    ]
    figure = charts.bop_curves(targets)
    assert figure is not None
    mssd, mspd = figure.axes[0].lines
    assert list(mssd.get_xdata()) == list(range(5, 51, 5))
    assert list(mssd.get_ydata()) == [0.0, 0.0, *[0.5] * 7, 1.0]
    assert list(mspd.get_ydata()) == [0.5] * 10
    assert charts.bop_curves([*targets, target(True)]) is None


def test_errors_by_distance_are_points_of_right_and_wrong_poses() -> None:
    targets = [target(True), target(False, add_error=0.05), target(False, found=False)]
    scores = {(1, number, 6, 0): scored for number, scored in enumerate(targets)}
    scenes = {key: [*[0, 0, 0, 300] * 2, 0, 0, 0, 0] for key in [*scores, (2, 1, 1, 0)]}
    figure = charts.error_by_distance(scores, scenes)
    assert figure is not None
    (points,) = figure.axes[0].collections
    distance = 0.3 * math.sqrt(2.0)
    np.testing.assert_allclose(points.get_offsets(), [[distance, 2.0], [distance, 50.0]])
    assert len({tuple(color) for color in points.get_facecolors()}) == 2
    assert charts.error_by_distance(dict([*scores.items()][2:]), scenes) is None


@pytest.mark.parametrize(
    ("kind", "changed", "places"),
    [
        ("translation", {"translation_error": 0.5}, (1, 23)),  # bins of 1.67 mm
        ("rotation", {"rotation_error": math.pi}, (4, 23)),  # bins of 1.25 degrees
    ],
)
def test_right_and_wrong_targets_are_counted_by_error(
    kind: str, changed: dict[str, float], places: tuple[int, int]
) -> None:
    targets = [target(True), target(True), target(False, **changed), target(False, found=False)]
    (ax,) = charts.error_histogram(targets, kind).axes
    right, wrong = ([int(bar.get_height()) for bar in group] for group in ax.containers)
    assert (sum(right), sum(wrong)) == (2, 1)
    assert (right[places[0]], wrong[places[1]]) == (2, 1)
