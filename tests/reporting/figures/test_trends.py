from itertools import pairwise
from typing import Any

import pytest
from matplotlib.container import BarContainer

from hlp.reporting.figures.trends import TRENDS, draw_trend, trend_table
from hlp.reporting.results import Result
from written_results import CONFIG, scored


def result(add: float, ms: float, chosen: str = "pso", **groups: dict[str, Any]) -> Result:
    config = {key: {**value, **groups.get(key, {})} for key, value in CONFIG.items()}
    summary = scored(add, ms, {"cat": add})
    return Result({"name": "x", **config}, summary, 2, {"refinement": chosen})


def dimensions(*pairs: tuple[int, float, float]) -> list[Result]:
    return [result(add, ms, encoder={"dimension": length}) for length, add, ms in pairs]


ARMS = dimensions((100, 0.7, 300.0), (200, 0.8, 350.0), (400, 0.75, 500.0))


def test_values_are_those_of_the_configuration() -> None:
    arm = result(
        0.5,
        9.0,
        "paper",
        encoder={"dimension": 600},
        refinement={"particles": 50, "theta_deg": 2.0, "tau_mm": 7.5},
    )
    found = {name: trend.value(arm) for name, trend in TRENDS.items()}
    assert found == {
        "fig9a": "600",
        "fig9b": "50",
        "fig9c": "{2°, 7.5 mm}",
        "pso_vs_icp": "paper",
    }


def test_what_the_paper_chose_is_the_default_of_its_method() -> None:
    """Its numbers stand beside 200 dimensions, 25 particles, {5°, 5 mm}: the tests' CONFIG."""
    assert all(trend.value(result(0.5, 9.0)) in trend.paper_values for trend in TRENDS.values())


def test_papers_numbers_stand_beside_its_own_setting_alone() -> None:
    table = trend_table(TRENDS["fig9a"], {"": ARMS})
    rows = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    assert [row["length of the local feature"] for row in rows] == ["100", "200", "400"]
    assert [row["ADD(-S)"] for row in rows] == ["0.700", "0.800", "0.750"]
    assert [row["95 %"] for row in rows] == ["0.600-0.740", "0.700-0.840", "0.650-0.790"]
    assert [row["ms"] for row in rows] == ["300", "350", "500"]
    assert [(row["paper ADD(-S)"], row["paper ms"]) for row in rows] == [
        ("", ""),
        ("0.960", "800"),
        ("", ""),
    ]


def test_what_else_was_swept_is_a_column_and_a_line_of_its_own() -> None:
    series = {"method paper": ARMS[:2], "method hlp": ARMS[1:]}
    table = trend_table(TRENDS["fig9a"], series)
    assert [row[1] for row in table.rows] == ["method paper"] * 2 + ["method hlp"] * 2
    ax, *_ = draw_trend(TRENDS["fig9a"], series, "a set").axes
    bars = [each for each in ax.containers if isinstance(each, BarContainer)]
    assert [each.get_label() for each in bars] == ["method paper", "method hlp"]
    edges = [(bar.get_x(), bar.get_x() + bar.get_width()) for each in bars for bar in each]
    assert all(before[1] <= after[0] for before, after in pairwise(sorted(edges)))


def test_three_panels_show_recalls_with_intervals_and_stacked_times() -> None:
    figure = draw_trend(TRENDS["fig9a"], {"": ARMS}, "a set")
    add, pose, time = figure.axes
    for ax, shift in ((add, 0.0), (pose, -0.2)):
        bars, intervals = ax.containers
        heights = [bar.get_height() for bar in bars]
        assert heights == pytest.approx([0.7 + shift, 0.8 + shift, 0.75 + shift])
        _, _, (stems,) = intervals.lines
        ends = [tuple(segment[:, 1]) for segment in stems.get_segments()]
        assert ends[1] == pytest.approx((0.7 + shift, 0.84 + shift))
        low, high = ax.get_ylim()
        assert low < 0.6 + shift and high > 0.84 + shift
        assert ax.get_ylabel() == f"axis cut: begins at {low:.2f}"
    # Bars end at their labels, though medians of stages do not add up to the whole's.
    heights = [bar.get_height() for bar in time.patches if bar.get_height() > 2]
    assert sum(heights) == pytest.approx(300 + 350 + 500)
    assert {text.get_text() for text in time.texts} == {"300", "350", "500", "paper's choice"}
    assert [text.get_text() for text in add.get_xticklabels()] == ["100", "200", "400"]
    note = figure.get_supxlabel().replace("\n", " ")
    assert "no values for this figure: compare the trends" in note


def test_the_papers_choice_is_marked_and_its_recall_stands_there() -> None:
    add, *_ = draw_trend(TRENDS["fig9a"], {"": ARMS}, "a set").axes
    (paper,) = [each for each in add.get_lines() if each.get_label() == "paper, Table 1"]
    assert paper.get_ydata()[0] == 0.960
    assert abs(paper.get_xdata()[0] - 1) < 0.3
    (mark,) = [text for text in add.texts if text.get_text() == "paper's choice"]
    assert mark.get_position()[0] == 1
    without = draw_trend(TRENDS["fig9a"], {"": [ARMS[0], ARMS[2]]}, "a set").axes
    texts = [text.get_text() for ax in without for text in ax.texts]
    labels = [line.get_label() for ax in without for line in ax.get_lines()]
    assert not [each for each in (*texts, *labels) if "paper" in each]
