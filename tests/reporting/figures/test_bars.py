"""Bars in panels: runs, the paper's numbers, times of a benchmark, causes of misses."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import Bar, Panel, bench_bars, draw_bars, run_panels, stacked_bars
from hlp.reporting.paper_reports import TRENDS, Recalls, draw_trend
from hlp.reporting.results import Result
from written_bench import bench_result
from written_results import CONFIG, scored


def bars_of(ax: Any) -> list[tuple[float, float, float]]:
    """Row, beginning and length of every bar."""
    return [(b.get_y() + b.get_height() / 2, b.get_x(), b.get_width()) for b in ax.patches]


def words(labels: Any) -> list[str]:
    return [label.get_text() for label in labels]


def test_recalls_are_points_with_intervals_on_an_axis_that_holds_them_all() -> None:
    bars = [Bar(0.975, "0.975", (0.94, 1.0)), None, Bar(0.912, "0.912", (0.84, 0.96))]
    (ax,) = draw_bars(["a", "b", "c"], [Panel("", {"": bars}, recall=True)], "title").axes
    low, high = ax.get_xlim()
    assert 0.8 < low < 0.84 and 1.0 < high < 1.4
    assert words(ax.get_yticklabels()) == ["a", "b", "c"]
    bottom, top = ax.get_ylim()
    assert bottom > 2 > 0 > top  # the first row at the top
    assert not bars_of(ax)  # their length would mean nothing
    points, *intervals = ([*line.get_xdata()] for line in ax.get_lines())
    assert points == [0.975, 0.912]
    assert intervals == [[0.94, 1.0], [0.84, 0.96]]


def test_bars_of_several_series_stand_beside_each_other_and_losses_go_to_the_left() -> None:
    series = {"a": [Bar(0.1), Bar(-0.2)], "b": [Bar(0.3), None]}
    (ax,) = draw_bars(["x", "y"], [Panel("", series)], "", marked=[1]).axes
    bars = bars_of(ax)[:3]
    np.testing.assert_allclose([row for row, *_ in bars], [-0.2, 0.8, 0.2])
    assert [length for *_, length in bars] == [0.1, -0.2, 0.3]
    assert ax.get_xlim()[0] < -0.2
    assert words(ax.get_legend().get_texts()) == ["a", "b"]
    band = ax.patches[-1].get_extents().transformed(ax.transData.inverted())
    assert sorted((band.y0, band.y1)) == pytest.approx([0.54, 1.46])


def test_runs_have_two_recalls_and_the_times_of_their_stages() -> None:
    medians = {"total": 90.0, "voting": 20.0, "local": 10.0, "refinement": None}
    timing = {stage: {"median": median, "p95": None} for stage, median in medians.items()}
    first = {**scored(0.7, 0.0, {"cat": 0.7}), "timing_ms": timing}
    add, pose, time = run_panels([first, scored(0.8, 40.0, {"cat": 0.8})])
    assert add.series[""][1] == Bar(0.8, "0.800", (pytest.approx(0.7), pytest.approx(0.84)))
    assert [bar.value for bar in pose.series[""] if bar] == pytest.approx([0.5, 0.6])
    # Medians of stages do not add up to the whole's, where the stacks end.
    assert time.series == {
        "voting": [Bar(60.0), None], "local": [Bar(30.0), None], "refinement": [None, Bar(40.0)],
    }  # fmt: skip
    assert time.stacked and time.totals == ["90.0", "40.0"]
    loaded = [{**first, "timing": {"cpu_ms": None, "load": load}} for load in (1.4, 6.5)]
    assert run_panels(loaded)[2].totals == ["90.0 (load 1.4)", "90.0 (load 6.5)"]
    assert run_panels([loaded[0]] * 2)[2].totals == ["90.0", "90.0"]


def test_papers_choice_is_marked_with_its_recall() -> None:
    def run(particles: int, add: float) -> Result:
        config = {**CONFIG, "refinement": {**CONFIG["refinement"], "particles": particles}}
        return Result(config, scored(add, 100.0, {"cat": add}), 2, {})

    paper = [("method paper", run(5, 0.7)), ("method paper", run(25, 0.8))]
    figure = draw_trend(TRENDS["fig9b"], [*paper, ("method hlp", run(25, 0.9))], "a set")
    add, _, time = figure.axes
    assert words(add.get_yticklabels()) == [
        "5, method paper", "25, method paper (paper's choice)", "25, method hlp (paper's choice)",
    ]  # fmt: skip
    (paper,) = [line for line in add.get_lines() if line.get_label() == "paper, Table 1"]
    assert paper.get_xydata().tolist() == [[0.96, 1], [0.96, 2]]
    assert not [line for line in time.get_lines() if line.get_label() == "paper, Table 1"]
    assert "Fig. 9b, particles N: a set" in figure.get_suptitle()


def test_others_numbers_are_points_and_unknown_ones_have_no_bar() -> None:
    ours = {
        "a": [{"recall": 0.5, "ci95": [0.4, 0.6]}, {}],
        "b": [{"recall": 0.9, "ci95": [0.7, 0.95]}, {"recall": 0.8, "ci95": [0.6, 0.85]}],
    }
    recalls = Recalls(["cat", "ape"], {"paper": [0.979, 0.970]}, ours)
    (ax,) = recalls.figure("title", "note").axes
    assert [length for *_, length in bars_of(ax)] == [0.5, 0.9, 0.8]
    (paper,) = [line for line in ax.get_lines() if line.get_label() == "paper"]
    assert paper.get_xydata().tolist() == [[0.979, 0], [0.970, 1]]
    assert sorted(words(ax.get_legend().get_texts())) == ["a", "b", "paper"]


def test_bars_of_a_bench_are_the_stages_and_end_at_the_median_of_the_whole() -> None:
    result = bench_result()
    first = {
        "network": {"median_ms": 9.0},
        "stage 1": {"median_ms": 10.0},
        "stage 2": {"median_ms": 30.0},
        "total": {"median_ms": 41.0},
    }
    result["paths"]["configured"] |= {"first": first, "further": {}}  # one object a frame
    (ax,) = bench_bars(result).axes
    assert words(ax.get_yticklabels()) == [
        "configured: first", "configured: frame",
        "reference: first", "reference: further", "reference: frame",
    ]  # fmt: skip
    bars = bars_of(ax)
    parts = [end for row, *ends in bars if row == 0 for end in ends]
    assert parts == pytest.approx([0.0, 10.25, 10.25, 30.75])
    assert [length for _, begin, length in bars[:5]] == pytest.approx([10.25, 20, 30, 7.5, 60])
    assert words(ax.texts) == ["41.0", "20.0", "30.0", "7.5", "60.0"]
    assert ax.get_xlim()[1] > 60.0


def waterfall() -> dict[str, Any]:
    cat = {"correct": 6, "no_window": 0, "few_votes": 1, "ranking": 1}
    ape = {"correct": 0, "no_window": 0, "few_votes": 2, "ranking": 0}
    total = {name: cat[name] + ape[name] for name in cat}
    return {
        "total": total,
        "per_object": {"cat": cat, "ape": ape},
        "per_visibility": {"0.3-0.6": ape, "0.6-1": cat},
    }


def test_bars_are_the_shares_lost_stacked_by_cause() -> None:
    figure = stacked_bars(waterfall())
    (ax,) = figure.axes
    assert words(ax.get_yticklabels()) == [
        "cat (8)", "ape (2)", "visible 0.3-0.6 (2)", "visible 0.6-1 (8)",
    ]  # fmt: skip
    few, ranking = ax.containers
    assert [bar.get_width() for bar in few] == pytest.approx([1 / 8, 1.0, 1.0, 1 / 8])
    assert [bar.get_x() for bar in ranking] == pytest.approx([1 / 8, 1.0, 1.0, 1 / 8])
    assert [bar.get_width() for bar in ranking] == pytest.approx([1 / 8, 0.0, 0.0, 1 / 8])
    assert words(ax.get_legend().get_texts()) == ["few votes", "ranking"]  # those that lost any
    assert figure.get_suptitle() == "4 of 10 targets missed, by cause"


def test_png_and_svg_are_written_and_the_same_again(tmp_path: Path) -> None:
    png, svg = save_figure(stacked_bars(waterfall()), tmp_path / "waterfall")
    assert cv2.imread(str(png)).shape[1] > 400
    first = svg.read_bytes()
    save_figure(stacked_bars(waterfall()), tmp_path / "waterfall")
    assert svg.read_bytes() == first
    cat = {"correct": 3, "ranking": 0}  # nothing lost is drawn too
    none = {"total": cat, "per_object": {"cat": cat}, "per_visibility": {"0.6-1": cat}}
    save_figure(stacked_bars(none), tmp_path / "waterfall")
    assert svg.read_bytes() != first
