"""The numbers of studies as bars: a group of bars for each arm of a sweep."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from hlp.reporting.figures.sweep_panels import COLORS
from hlp.reporting.study_numbers import StudyNumber

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BAR = 0.2  # inches
_GROUP = 0.8  # share of an arm's row that its bars take up
_ROOM = 0.3  # of an axis, beyond the data, for the numbers
_CUT = 0.5  # recalls that are all higher have an axis that begins below them
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
    low, high = _ends(numbers)
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
    ax.set_xlim(low, high + _ROOM * (high - low))
    ax.set_xticks([tick for tick in ax.get_xticks() if low <= tick <= high + 1e-9])
    ax.set_xlabel(f"axis cut: begins at {low:g}" if low > 0 else "", fontsize=8)
    ax.tick_params(labelsize=8)
    ax.grid(axis="x", alpha=0.3)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def _ends(numbers: Sequence[StudyNumber]) -> tuple[float, float]:
    """Where the axis begins and ends: high recalls from the largest tenth below, others from 0."""
    ends = [end for each in numbers for end in (each.value, *(each.interval or ()))]
    lowest, highest = min(ends), max(ends)
    if all(each.quantity == "recall" for each in numbers):
        begin = math.floor(10.0 * lowest - 1e-9) / 10.0
        return (begin if begin >= _CUT else 0.0), max(highest, 0.1)
    return min(1.2 * lowest, 0.0), max(highest, 0.02)
