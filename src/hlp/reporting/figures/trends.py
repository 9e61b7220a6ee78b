"""Recall and time against one setting: the paper's Fig. 9, and particle swarm against ICP."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hlp.reporting.figures.sweep_panels import SweepFigure, SweepPoint, draw_sweep
from hlp.reporting.paper_results import ADD_MEAN, MS_PER_FRAME
from hlp.reporting.results import Result
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, format_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Trend:
    """A figure of recall and time against one setting, the horizontal axis.

    `keys` are the configuration keys that change along the axis, and `value` gives a run's value as
    text. `paper_values` are the values that the paper chose. `note` says how far the figure can be
    compared with the paper.
    """

    title: str
    axis: str
    keys: tuple[str, ...]
    value: Callable[[Result], str]
    paper_values: tuple[str, ...]
    note: str


def _feature_length(result: Result) -> str:
    return str(result.config["encoder"]["dimension"])


def _particles(result: Result) -> str:
    return str(result.config["refinement"]["particles"])


def _box(result: Result) -> str:
    refinement = result.config["refinement"]
    return f"{{{refinement['theta_deg']:g}°, {refinement['tau_mm']:g} mm}}"


def _refinement(result: Result) -> str:
    return result.chosen.get("refinement", str(result.config["refinement"]["name"]))


_NO_VALUES = "The paper's text gives no values for this figure: compare the trends, not numbers."
_BOX_KEYS = ("refinement.theta_deg", "refinement.tau_mm")
TRENDS = {
    "fig9a": Trend(
        "Fig. 9a",
        "length of the local feature",
        ("encoder.dimension",),
        _feature_length,
        ("200",),
        _NO_VALUES,
    ),
    "fig9b": Trend(
        "Fig. 9b", "particles N", ("refinement.particles",), _particles, ("25",), _NO_VALUES
    ),
    "fig9c": Trend(
        "Fig. 9c", "box of the search {θ, τ}", _BOX_KEYS, _box, ("{5°, 5 mm}",), _NO_VALUES
    ),
    "pso_vs_icp": Trend(
        "PSO against ICP",
        "refinement",
        ("refinement",),
        _refinement,
        ("pso", "paper"),
        "The paper discusses it in words.",
    ),
}
"""The figures by the name of their experiment."""

Series = Mapping[str, Sequence[Result]]


def trend_note(trend: Trend) -> str:
    """The caption: what the paper's points are."""
    return (
        f"{trend.note} Beside ours is the paper's result with its own setting,"
        f" {trend.paper_values[0]}: mean ADD(-S) {ADD_MEAN:.3f} on LINEMOD's whole sequences"
        f" (Table 1), about {MS_PER_FRAME:.0f} ms a frame (i7, GTX 970M)."
    )


def trend_table(trend: Trend, series: Series) -> Table:
    """A row for each run: recalls, the 95 % interval of ADD(-S), times, and the paper's numbers.

    The paper's numbers stand in the row of the setting that it chose. `series` are the runs by the
    other swept settings, in words (empty if there are none).
    """
    several = [""] if len(series) > 1 else []
    rows = []
    for name, results in series.items():
        for result in results:
            value = trend.value(result)
            metrics, times = result.summary["metrics"], result.summary["timing_ms"]
            paper = (
                (f"{ADD_MEAN:.3f}", f"{MS_PER_FRAME:.0f}")
                if value in trend.paper_values
                else ("", "")
            )
            rows.append(
                [
                    value,
                    *(name for _ in several),
                    str(result.summary["targets"]),
                    f"{metrics['add']['recall']:.3f}",
                    format_interval(metrics["add"]["ci95"]),
                    *(f"{metrics[key]['recall']:.3f}" for key in METRIC_LABELS if key != "add"),
                    f"{times['refinement']['median']:.0f}",
                    f"{times['total']['median']:.0f}",
                    f"{times['total']['p95']:.0f}",
                    *paper,
                ]
            )
    others = [shown for key, shown in METRIC_LABELS.items() if key != "add"]
    ours = ["targets", METRIC_LABELS["add"], "95 %", *others, "ms refinement", "ms", "ms 95 %"]
    return Table([trend.axis, *several, *ours, "paper ADD(-S)", "paper ms"], rows)


def draw_trend(trend: Trend, series: Series, data: str) -> "Figure":
    """ADD(-S) and 5cm5deg recall with 95 % intervals, and the times of the stages.

    `data` says in words what was measured on.
    """
    points = {
        name: [SweepPoint.of(trend.value(each), each.summary) for each in results]
        for name, results in series.items()
    }
    words = SweepFigure(
        title=f"{trend.title}: {data}",
        axis=trend.axis,
        marked=trend.paper_values,
        mark="paper's choice",
        published=("paper, Table 1", ADD_MEAN),
        note=trend_note(trend),
    )
    return draw_sweep(words, points)
