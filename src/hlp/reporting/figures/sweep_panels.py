"""A sweep of one setting as bars in three panels: ADD(-S), 5cm5deg, and time by stage."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hlp.reporting.study_numbers import StudyNumber
from hlp.reporting.tables.summary_tables import METRIC_LABELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Interval = tuple[float, float]

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Of series; the colour-blind tell them apart too (Okabe and Ito, 2008)."""
STAGE_COLORS = {
    "holistic": "#56b4e9",
    "local": "#e69f00",
    "voting": "#009e73",
    "refinement": "#cc79a7",
    "other stages": "#bbbbbb",
}
_BAND = "#f3ecd2"
_ROOM = 0.30  # of an axis, above the data
_PLACE = 0.8  # share of a value's place that its series take up
_CUT = 0.02  # a recall axis that begins above this is said to be cut
_LONG = 9  # characters from which labels of values are broken or turned


@dataclass(frozen=True)
class SweepPoint:
    """One arm: its value as text, recalls with 95 % intervals (None: not known), times (ms).

    `stages` are the median times of the stages, `total_ms` the median of the whole.
    """

    value: str
    recall: float
    interval: Interval | None
    pose_recall: float
    pose_interval: Interval | None
    stages: Mapping[str, float]
    total_ms: float

    @classmethod
    def of(cls, value: str, summary: Mapping[str, Any]) -> "SweepPoint":
        """The point of a run, given its `summary.json`."""
        add, pose = (summary["metrics"][key] for key in ("add", "5cm5deg"))
        times = {k: v["median"] for k, v in summary["timing_ms"].items() if v["median"] is not None}
        total = times.pop("total", sum(times.values()))
        ends = [(float(each["ci95"][0]), float(each["ci95"][1])) for each in (add, pose)]
        return cls(value, add["recall"], ends[0], pose["recall"], ends[1], times, total)


@dataclass(frozen=True)
class SweepFigure:
    """What a figure of a sweep says beside its points.

    `marked` are values to be marked, with the words `mark`. `published` is a recall and its
    source, drawn beside ours at these values.
    """

    title: str
    axis: str
    marked: Sequence[str] = ()
    mark: str = ""
    published: tuple[str, float] | None = None
    note: str = ""


Series = Mapping[str, Sequence[SweepPoint]]


def draw_sweep(words: SweepFigure, series: Series) -> "Figure":
    """Three panels beside each other over the same values, for one or several series of points."""
    from matplotlib.figure import Figure

    values = list(dict.fromkeys(point.value for points in series.values() for point in points))
    figure = Figure(figsize=(9.2, 3.7 + 0.16 * bool(words.note)), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _draw_recalls(left, words, series, values, METRIC_LABELS["add"], words.published)
    _draw_recalls(middle, words, series, values, METRIC_LABELS["5cm5deg"], None)
    _draw_times(right, series, values)
    long = len(values) > 2 and max(map(len, values)) >= _LONG
    shown = [value.replace(", ", ",\n") if long else value for value in values]
    turned = long and not any("\n" in each for each in shown)
    for ax in (left, middle, right):
        ax.set_xticks(range(len(values)), shown, rotation=20 if turned else 0)
        ax.tick_params(labelsize=8)
        ax.set_xlim(-0.6, len(values) - 0.4)
        ax.set_xlabel(words.axis)
        ax.spines[["top", "right"]].set_visible(False)
        ax.set_axisbelow(True)
        for place in (i for i, value in enumerate(values) if value in words.marked):
            ax.axvspan(place - 0.46, place + 0.46, color=_BAND, zorder=0)
            ax.text(place, 0.995, words.mark, transform=ax.get_xaxis_transform(), ha="center",
                    va="top", fontsize=7.5, color="#6b5500")  # fmt: skip
    handles, labels = left.get_legend_handles_labels()
    if labels:  # beside the panels: bars fill them
        figure.legend(handles, labels, loc="outside upper right", ncols=4, frameon=False,
                      fontsize=7.5)  # fmt: skip
    figure.suptitle(words.title, fontsize=10.5, x=0.01, ha="left")
    if words.note:
        figure.supxlabel(textwrap.fill(words.note, 150), fontsize=7, x=0.01, ha="left")
    return figure


def _draw_recalls(
    ax: "Axes",
    words: SweepFigure,
    series: Series,
    values: Sequence[str],
    metric: str,
    published: tuple[str, float] | None,
) -> None:
    first = metric == METRIC_LABELS["add"]
    seen: list[float] = []
    for number, (name, points) in enumerate(series.items()):
        recalls = [point.recall if first else point.pose_recall for point in points]
        known = [point.interval if first else point.pose_interval for point in points]
        ends = [each or (recall, recall) for each, recall in zip(known, recalls, strict=True)]
        places = [values.index(point.value) + _shift(number, len(series)) for point in points]
        below = [max(recall - low, 0.0) for recall, (low, _) in zip(recalls, ends, strict=True)]
        above = [max(high - recall, 0.0) for recall, (_, high) in zip(recalls, ends, strict=True)]
        ax.bar(places, recalls, 0.9 * _PLACE / len(series), label=name or None,
               color=COLORS[number % len(COLORS)])  # fmt: skip
        if any(known):
            ax.errorbar(places, recalls, (below, above), fmt="none", capsize=3, linewidth=1.3,
                        color="#222222")  # fmt: skip
        seen += [end for each in ends for end in each]
        for place, recall, (_, high) in zip(places, recalls, ends, strict=True):
            if len(series) == 1:
                _write(ax, place, high, f"{recall:.3f}")
            else:  # within the bar, at its foot: there is no room beside the interval
                foot = ax.get_xaxis_transform()
                ax.text(place, 0.02, f"{recall:.3f}", transform=foot, rotation=90, ha="center",
                        va="bottom", fontsize=7, color="white")  # fmt: skip
    marked = [i + 0.25 for i, value in enumerate(values) if value in words.marked]
    if published is not None and marked:
        source, value = published
        ax.plot(marked, [value] * len(marked), "kD", markerfacecolor="white", label=source)
        seen.append(value)
    low, high = _ends(seen)
    ax.set_ylim(low, high)
    ax.set_yticks([each for each in ax.get_yticks() if low <= each <= 1.0 + 1e-9])
    ax.set_title(f"{metric} recall, 95 % interval" if _has_interval(series, first)
                 else f"{metric} recall", fontsize=9)  # fmt: skip
    ax.set_ylabel(f"axis cut: begins at {low:.2f}" if low > _CUT else "recall", fontsize=8)
    ax.grid(axis="y", alpha=0.3)


def _has_interval(series: Series, first: bool) -> bool:
    points = [point for some in series.values() for point in some]
    return any((point.interval if first else point.pose_interval) is not None for point in points)


def _ends(seen: Sequence[float]) -> Interval:
    """The axis around the data, with room above for the numbers; from 0 if they come near it."""
    low, high = min(seen), max(seen)
    span = max(high - low, 0.04)
    start = math.floor((low - 0.25 * span) * 50) / 50
    return (0.0 if start < 0.15 else start), high + _ROOM * span


def _draw_times(ax: "Axes", series: Series, values: Sequence[str]) -> None:
    width = _PLACE / max(len(series), 1)
    named: set[str] = set()
    highest = 0.0
    for number, points in enumerate(series.values()):
        for point in points:
            place, bottom = values.index(point.value) + _shift(number, len(series)), 0.0
            # Medians of the stages do not add up to the median of the whole.
            share = point.total_ms / (sum(point.stages.values()) or 1.0)
            for stage, time in point.stages.items():
                label = None if stage in named else stage
                ax.bar(place, share * time, 0.9 * width, bottom,
                       color=STAGE_COLORS.get(stage), label=label)  # fmt: skip
                named.add(stage)
                bottom += share * time
            _write(ax, place, bottom, f"{point.total_ms:.0f}")
            highest = max(highest, bottom)
    ax.set_ylim(0, 1.45 * max(highest, 1.0))
    ax.set_title("ms an object and frame, median, by stage", fontsize=9)
    ax.grid(axis="y", alpha=0.3)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[::-1], labels[::-1], loc="upper left", ncols=2, frameon=False, fontsize=7.5,
              bbox_to_anchor=(0.0, 0.95), columnspacing=1.0, handlelength=1.2)  # fmt: skip


def _shift(number: int, of: int) -> float:
    return _PLACE / max(of, 1) * (number - (of - 1) / 2)


def _write(ax: "Axes", x: float, y: float, text: str) -> None:
    ax.annotate(text, (x, y), (0, 5), textcoords="offset points", ha="center", fontsize=8)


_BAR = 0.2  # inches
_GROUP = 0.8  # share of an arm's row that its bars take up
_ROOM_BESIDE = 0.3  # of an axis, beyond the data, for the numbers
_STUDY_CUT = 0.5  # recalls that are all higher have an axis that begins below them
_CHARACTER = 0.08  # inches, of the title
_LONGEST = 28  # characters of an arm's name on one line


def draw_study_arms(arms: Mapping[str, Sequence[StudyNumber]], title: str) -> "Figure":
    """A panel for each kind of number, beside each other; the first arm is at the top.

    Lines are 95 % intervals. An axis of high recalls is cut, which it says.
    """
    from matplotlib.figure import Figure

    panels: dict[str, list[str]] = {}
    for numbers in arms.values():
        for each in [each for each in numbers if each.panel]:
            names = panels.setdefault(each.panel, [])
            if each.name not in names:
                names.append(each.name)
    most = max(map(len, panels.values()))
    height = _BAR * len(arms) * (most + 1) + 1.4 + 0.2 * most
    width = max(2.6 * len(panels) + 0.8, 5.0)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, (panel, names) in zip(axes, panels.items(), strict=True):
        found = [{n.name: n for n in numbers if n.panel == panel} for numbers in arms.values()]
        _draw(ax, names, found)
        ax.set_title(textwrap.fill(panel, 32), fontsize=9)
        if len(names) > 1:
            ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.6 / height), ncols=2,
                      frameon=False, fontsize=7.5)  # fmt: skip
    shown = [textwrap.fill(label, _LONGEST) for label in arms]
    axes[0].set_yticks(range(len(arms)), shown, fontsize=8)
    axes[0].invert_yaxis()
    figure.suptitle(textwrap.fill(title, int(width / _CHARACTER)), fontsize=10, x=0.01, ha="left")
    return figure


def _draw(ax: "Axes", names: Sequence[str], arms: Sequence[Mapping[str, StudyNumber]]) -> None:
    width = _GROUP / len(names)
    numbers = [number for found in arms for number in found.values()]
    low, high = _study_ends(numbers)
    for place, name in enumerate(names):
        color, shift = COLORS[place % len(COLORS)], width * (place - (len(names) - 1) / 2)
        rows = [row for row, found in enumerate(arms) if name in found]
        bars = [arms[row][name] for row in rows]
        middles = [row + shift for row in rows]
        ax.barh(middles, [bar.value for bar in bars], 0.9 * width, color=color, label=name)
        for y, bar in zip(middles, bars, strict=True):
            end = max(bar.value, 0.0)
            if bar.interval is not None:
                ax.plot(bar.interval, (y, y), color="#222222", linewidth=1.2)
                end = max(end, bar.interval[1])
            ax.annotate(bar.text, (end, y), (3, 0), textcoords="offset points", va="center",
                        fontsize=7.5)  # fmt: skip
    ax.axvline(0.0, color="0.4", linewidth=0.8)
    ax.set_xlim(low, high + _ROOM_BESIDE * (high - low))
    ax.set_xticks([tick for tick in ax.get_xticks() if low <= tick <= high + 1e-9])
    ax.set_xlabel(f"axis cut: begins at {low:g}" if low > 0 else "", fontsize=8)
    ax.tick_params(labelsize=8)
    ax.grid(axis="x", alpha=0.3)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def _study_ends(numbers: Sequence[StudyNumber]) -> tuple[float, float]:
    """Where the axis begins and ends: high recalls from the largest tenth below, others from 0."""
    ends = [end for each in numbers for end in (each.value, *(each.interval or ()))]
    lowest, highest = min(ends), max(ends)
    if all(each.quantity == "recall" for each in numbers):
        begin = math.floor(10.0 * lowest - 1e-9) / 10.0
        return (begin if begin >= _STUDY_CUT else 0.0), max(highest, 0.1)
    return min(1.2 * lowest, 0.0), max(highest, 0.02)
