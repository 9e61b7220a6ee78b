"""The charts of a run's page."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hlp.records import TargetScore
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.figures import charts
from hlp.reporting.summary_tables import ADD_BY_OBJECT
from written_summary import summary


def target(right: bool, **changes: Any) -> ScoredTarget:
    """A target of the cat: 2 mm and 6 degrees off, half visible, unless changed."""
    score = TargetScore(
        1, 2, 6, True, 0.55, 0.002, np.radians(6.0), 0.002, 0.9, right, right, right
    )
    return ScoredTarget("cat", replace(score, **changes))


def drawn(figure: Any) -> tuple[list[str], list[float], list[str]]:
    """Rows of a figure of bars: their names, lengths and words."""
    (ax,) = figure.axes
    names = [label.get_text() for label in ax.get_yticklabels()]
    return names, [bar.get_width() for bar in ax.patches], [text.get_text() for text in ax.texts]


def test_objects_have_bars_with_intervals_and_the_papers_recall() -> None:
    written = summary(("cat", "ape"))
    written["per_object"]["cat"]["add"] = {"recall": 0.75, "ci95": [0.6, 0.8]}
    figure = charts.object_bars(written)
    assert drawn(figure) == (["cat", "ape"], [0.75, 0.5], ["0.750", "0.500"])
    lines = {str(line.get_label()): line.get_xdata() for line in figure.axes[0].lines}
    assert list(lines["paper"]) == [ADD_BY_OBJECT["cat"], ADD_BY_OBJECT["ape"]]
    assert [0.6, 0.8] in [list(ends) for ends in lines.values()]
    unknown = charts.object_bars(summary(("mug",)))
    assert "paper" not in {line.get_label() for line in unknown.axes[0].lines}


def test_recall_by_visible_fraction_names_the_number_of_targets() -> None:
    targets = [target(True), target(False), target(True, visible_fraction=1.0)]
    figure = charts.visibility_bars([*targets, target(True, visible_fraction=math.nan)])
    assert drawn(figure) == (["0.5 to 0.6 (2)", "0.9 to 1.0 (1)"], [0.5, 1.0], ["0.500", "1.000"])
    assert charts.visibility_bars([target(True, visible_fraction=math.nan)]) is None


def test_times_are_medians_with_the_95th_percentile() -> None:
    written = summary()
    figure = charts.timing_bars(written)
    assert drawn(figure) == (["total", "voting"], [480.0, 2.34], ["480 (700)", "2.34"])
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
