"""Bars with 95 % intervals, in panels beside each other that share their rows.

All that is compared row by row is drawn so: the runs of a sweep, studies, the paper's figures and
tables beside ours, the parts of a benchmark, the causes of misses.
"""

import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.reporting.comparison import Difference
from hlp.reporting.figures import new_figure
from hlp.reporting.study_tables import TIMED, TOTAL, format_ms
from hlp.reporting.summary_tables import METRIC_LABELS, paper_recalls, run_cells
from hlp.results.recalls import CORRECT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Of series; the colour-blind tell them apart too (Okabe and Ito, 2008)."""
STAGE_COLORS = {
    **dict.fromkeys(("holistic", "stage 1"), "#56b4e9"),
    **dict.fromkeys(("local", "stage 2"), "#e69f00"),
    "voting": "#009e73",
    **dict.fromkeys(("refinement", "stage 3"), "#cc79a7"),
}
"""One colour for each stage, also for the three of a bench; the second holds the voting."""
CAUSE_COLORS = {
    "bad_frame": "#000000",
    "depth_missing": "#7f7f7f",
    "no_window": "#b5dff7",
    "wrong_region": "#56b4e9",
    "few_votes": "#e69f00",
    "outside_basin": "#009e73",
    "screening": "#f0d0e0",
    "refiner_diverged": "#cc79a7",
    "ranking": "#9c4577",
    "symmetric_flip": "#5e2146",
}
"""One colour for each cause, the same in every figure: that of the stage that it is a cause of."""
_BAND = "#f3ecd2"
_BAR, _PANEL = 0.2, 2.9  # inches
_GROUP = 0.8  # share of a row that its bars take up
_ROOM = 0.3  # of an axis, beyond the data, for the numbers
_LONGEST = 45  # characters of a row's name on one line


@dataclass(frozen=True)
class Bar:
    """A value, what is written beside it, its 95 % interval, where known, and its own colour."""

    value: float
    text: str = ""
    interval: tuple[float, float] | None = None
    color: str = ""


@dataclass(frozen=True)
class Panel:
    """A bar for each row, or none, of one or several series.

    `stacked` bars stand one after another, and the text of `totals` behind the last. `published`
    are points for comparison. A `recall` is a point too, since its axis does not begin at 0.
    """

    title: str
    series: Mapping[str, Sequence[Bar | None]]
    recall: bool = False
    stacked: bool = False
    totals: Sequence[str] = ()
    published: Mapping[str, Sequence[float | None]] = field(default_factory=dict)
    colors: Mapping[str, str] = field(default_factory=dict)


def draw_bars(
    rows: Sequence[str],
    panels: Sequence[Panel],
    title: str,
    note: str = "",
    marked: Collection[int] = (),
) -> "Figure":
    """The panels side by side, the first row at the top; the `marked` rows have a band."""
    most = max(1 if panel.stacked else len(panel.series) for panel in panels)
    legends = max(len(panel.series) + len(panel.published) for panel in panels)
    height = _BAR * len(rows) * (most + 0.7) + 1.4 + 0.13 * legends + 0.4 * bool(note)
    width = max(_PANEL * len(panels) + 1.2, 6.0)
    figure = new_figure(width, height)
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, panel in zip(axes, panels, strict=True):
        _draw_panel(ax, panel, len(rows))
        for row in marked:
            ax.axhspan(row - 0.46, row + 0.46, color=_BAND, zorder=0)
        if len(panel.series) + len(panel.published) > 1:
            ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.6 / height), ncols=2,
                      frameon=False, fontsize=7.5)  # fmt: skip
    axes[0].set_yticks(range(len(rows)), [textwrap.fill(row, _LONGEST) for row in rows], fontsize=8)
    axes[0].set_ylim(len(rows) - 0.4, -0.6)
    figure.suptitle(textwrap.fill(title, int(12.5 * width)), fontsize=10, x=0.01, ha="left")
    if note:
        figure.supxlabel(textwrap.fill(note, int(17 * width)), fontsize=7, x=0.01, ha="left")
    return figure


def _draw_panel(ax: "Axes", panel: Panel, rows: int) -> None:
    for name, values in panel.published.items():
        known = [(value, row) for row, value in enumerate(values) if value is not None]
        ax.plot(*zip(*known, strict=True), "kD", markerfacecolor="white", label=name)
    if panel.stacked:
        _draw_stacks(ax, panel, rows)
    else:
        _draw_groups(ax, panel)
    if not panel.recall:
        ax.axvline(0.0, color="0.4", linewidth=0.8)
    begin, end = ax.dataLim.intervalx
    room = _ROOM * max(end - begin, 0.01)
    ax.set_xlim(begin - room * (begin != 0) / 4, end + room)
    ax.set_xticks([tick for tick in ax.get_xticks() if begin <= tick <= end])
    ax.set_title(textwrap.fill(panel.title, 36), fontsize=9)
    ax.tick_params(labelsize=8)
    ax.grid(axis="x", alpha=0.3)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def _draw_groups(ax: "Axes", panel: Panel) -> None:
    width = _GROUP / len(panel.series)
    for place, (name, bars) in enumerate(panel.series.items()):
        shift = width * (place - (len(panel.series) - 1) / 2)
        drawn = [(row + shift, bar) for row, bar in enumerate(bars) if bar is not None]
        values, places = [bar.value for _, bar in drawn], [y for y, _ in drawn]
        color = panel.colors.get(name, COLORS[place % len(COLORS)])
        if panel.recall:
            ax.plot(values, places, "o", color=color, label=name)
        else:
            colors = [bar.color or color for _, bar in drawn]
            ax.barh(places, values, 0.9 * width, label=name, color=colors)
        for y, bar in drawn:
            if bar.interval is not None:
                ax.plot(bar.interval, (y, y), color=color if panel.recall else "#222222")
            end = max(0.0, bar.value, *(bar.interval or ()))
            ax.annotate(bar.text, (end, y), (3, 0), textcoords="offset points", va="center",
                        fontsize=7.5)  # fmt: skip


def _draw_stacks(ax: "Axes", panel: Panel, rows: int) -> None:
    ends = np.zeros(rows)
    for place, (name, bars) in enumerate(panel.series.items()):
        lengths = np.array([bar.value if bar else 0.0 for bar in bars])
        ax.barh(range(rows), lengths, 0.75, ends, label=name,
                color=panel.colors.get(name, COLORS[place % len(COLORS)]))  # fmt: skip
        ends += lengths
    for row, text in enumerate(panel.totals):
        ax.annotate(text, (ends[row], row), (4, 0), textcoords="offset points", va="center",
                    fontsize=8)  # fmt: skip


def run_panels(summaries: Sequence[Mapping[str, Any]]) -> list[Panel]:
    """What is compared of runs, given each `summary.json`: two recalls, and time by stage."""
    panels = [
        Panel(f"{METRIC_LABELS[key]} recall, 95 % interval",
              {"": [recall_bar(summary["metrics"][key]) for summary in summaries]}, recall=True)
        for key in ("add", "5cm5deg")
    ]  # fmt: skip
    timings = [summary["timing_ms"] for summary in summaries]
    medians = [{stage: time["median"] for stage, time in own.items()} for own in timings]
    title = "ms an object and frame, median, by stage"
    return [*panels, _times_panel(title, medians, loads_in_words(summaries))]


def loads_in_words(summaries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Of each run ` (load 6.5)`, to stand behind its time; empty where all had the same.

    Times that were measured under different load of the machine cannot be compared without it.
    """
    loads = [run_cells(summary)["load"] for summary in summaries]
    return [f" (load {load})" if len({*loads}) > 1 else "" for load in loads]


def _times_panel(
    title: str, medians: Sequence[Mapping[str, float | None]], loads: Sequence[str] = ()
) -> Panel:
    """Stages one after another, shared out so that they end at the median of the whole.

    Medians of stages do not add up to it. `loads` stand behind it.
    """
    rows, totals = [], []
    for found in medians:
        known = {stage: median for stage, median in found.items() if median is not None}
        total = known.pop(TOTAL, sum(known.values()))
        scale = total / (sum(known.values()) or 1.0)
        rows.append({stage: Bar(scale * time) for stage, time in known.items()})
        totals.append(format_ms(total))
    totals = [f"{ms}{load}" for ms, load in zip_longest(totals, loads, fillvalue="")]
    stages = dict.fromkeys(stage for row in rows for stage in row)
    series = {stage: [row.get(stage) for row in rows] for stage in stages}
    return Panel(title, series, stacked=True, totals=totals, colors=STAGE_COLORS)


def recall_bar(metric: Mapping[str, Any]) -> Bar:
    """A recall of `summary.json` with its interval."""
    recall, (low, high) = float(metric["recall"]), metric["ci95"]
    return Bar(recall, f"{recall:.3f}", (float(low), float(high)))


def object_bars(summary: Mapping[str, Any]) -> "Figure":
    """ADD(-S) recall of each object with its 95 % interval; the paper's as a diamond."""
    scores = summary["per_object"]
    bars = [recall_bar(score["add"]) for score in scores.values()]
    paper = paper_recalls([*scores])
    published = {"paper": paper} if paper else {}
    panel = Panel("ADD(-S) recall, 95 % interval", {"ours": bars}, recall=True, published=published)
    return draw_bars(list(scores), [panel], "")


def gain_bar(found: Difference | None) -> Bar | None:
    """A difference of recalls with its interval, where there is one."""
    return found and Bar(found[0], f"{found[0]:+.3f}", found[1])


def bench_bars(result: Mapping[str, Any]) -> "Figure":
    """What bench.json holds: a bar for each path and unit (first object, …), stacked by stage."""
    timed = {
        f"{name}: {unit}": path[unit]
        for name, path in result["paths"].items()
        for unit in TIMED
        if path[unit]
    }
    medians = [
        {part: times[part]["median_ms"] for part in times if part == TOTAL or "stage " in part}
        for times in timed.values()
    ]
    title = "ms, medians of a frame's first object, of further ones, of whole frames"
    return draw_bars([*timed], [_times_panel("", medians)], title)


def stacked_bars(waterfall: Mapping[str, Any]) -> "Figure":
    """A bar for each object and class of visible fraction: misses stacked by cause.

    `waterfall` is the part of that name in `summary.json`.
    """
    groups = {
        f"{before}{name} ({sum(counts.values())})": counts
        for part, before in (("per_object", ""), ("per_visibility", "visible "))
        for name, counts in waterfall[part].items()
    }
    lost = {cause: count for cause, count in waterfall["total"].items() if cause != CORRECT}
    series = {
        cause.replace("_", " "): [
            Bar(counts[cause] / max(sum(counts.values()), 1)) for counts in groups.values()
        ]
        for cause, count in lost.items()
        if count
    }
    colors = {cause.replace("_", " "): color for cause, color in CAUSE_COLORS.items()}
    panel = Panel("share of targets missed by ADD(-S)", series, stacked=True, colors=colors)
    title = f"{sum(lost.values())} of {sum(waterfall['total'].values())} targets missed, by cause"
    return draw_bars([*groups], [panel], title)
