"""Recall and time against one setting: the paper's Fig. 9, and particle swarm against ICP."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hlp.reporting.paper_results import ADD_MEAN, MS_PER_FRAME
from hlp.reporting.results import Result
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, format_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_SPREAD = 0.08


@dataclass(frozen=True)
class Trend:
    """A figure of recall and time against one setting, the horizontal axis.

    `keys` are the configuration keys that change along the axis, and `value` gives a run's value as
    text. `paper_values` are the values that the paper chose. `note` says how far the figure can be
    compared with the paper. Points are `joined` by lines if the values are amounts.
    """

    title: str
    axis: str
    keys: tuple[str, ...]
    value: Callable[[Result], str]
    paper_values: tuple[str, ...]
    note: str
    joined: bool = True


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
        joined=False,
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
    """ADD(-S) recall with its 95 % interval, and the median time per target on the second axis.

    `data` says in words what was measured on.
    """
    from matplotlib.figure import Figure

    values = list(
        dict.fromkeys(trend.value(each) for results in series.values() for each in results)
    )
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    ax = figure.subplots()
    time_ax = ax.twinx()
    for i, (name, results) in enumerate(series.items()):
        shift = _SPREAD * (i - (len(series) - 1) / 2)
        places = [values.index(trend.value(each)) + shift for each in results]
        colors = (f"C{i}", f"C{i}") if len(series) > 1 else ("C0", "C1")
        line = _draw_recall(ax, places, results, f"ours {name}".strip(), colors[0])
        times = [each.summary["timing_ms"]["total"]["median"] for each in results]
        (time_line,) = time_ax.plot(places, times, "s--", color=colors[1], alpha=0.8)
        if not trend.joined:
            line.set_linestyle("")
            time_line.set(linestyle="", xdata=[place + _SPREAD for place in places])
    chosen = [i for i, value in enumerate(values) if value in trend.paper_values]
    if chosen:
        _draw_paper(ax, time_ax, chosen)
    _name_axes(ax, time_ax, trend, values)
    figure.legend(loc="outside upper center", ncols=4, frameon=False, fontsize=8)
    ax.set_title(f"{trend.title}: recall and time, {data}", fontsize=10)
    figure.supxlabel(textwrap.fill(trend_note(trend), 125), fontsize=7, x=0.01, ha="left")
    return figure


def _draw_recall(
    ax: "Axes", places: Sequence[float], results: Sequence[Result], label: str, color: str
) -> "Line2D":
    scores = [each.summary["metrics"]["add"] for each in results]
    recalls = [each["recall"] for each in scores]
    below = [each["recall"] - each["ci95"][0] for each in scores]
    above = [each["ci95"][1] - each["recall"] for each in scores]
    bars = ax.errorbar(
        places, recalls, (below, above), fmt="o-", capsize=3, color=color, label=label
    )
    line: Line2D = bars.lines[0]
    return line


def _draw_paper(ax: "Axes", time_ax: "Axes", places: Sequence[int]) -> None:
    """Recall left of the paper's setting and time right of it, so that neither hides the other."""
    left, right = ([place + side * _SPREAD for place in places] for side in (-1, 1))
    recalls, times = [ADD_MEAN] * len(places), [MS_PER_FRAME] * len(places)
    ax.plot(left, recalls, "D", color="black", label="paper's setting, Table 1")
    time_ax.plot(right, times, "s", color="black", fillstyle="none", label="paper's time")


def _name_axes(ax: "Axes", time_ax: "Axes", trend: Trend, values: Sequence[str]) -> None:
    ax.set_xticks(range(len(values)), values)
    ax.set_xlim(-0.5, len(values) - 0.5)
    ax.set_xlabel(trend.axis)
    ax.set_ylabel("● ADD(-S) recall, 95 % interval")
    ax.set_ylim(0.0, 1.03)
    time_ax.set_ylabel("■ ms for one object in one frame (median)")
    time_ax.set_ylim(0.0, 1.05 * time_ax.get_ylim()[1])
    ax.grid(axis="y", alpha=0.3)
    for each in (ax, time_ax):
        each.spines["top"].set_visible(False)
