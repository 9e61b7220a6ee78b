"""The paper's Tables 1 and 2 as a figure: its recalls, and ours with their intervals."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hlp.reporting.tables.paper_tables import RecallColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SPREAD = 0.15
_SHADES = ("black", "0.6")


def draw_recalls(
    rows: Sequence[str], columns: Sequence[RecallColumn], title: str, note: str
) -> "Figure":
    """A point for each row and column; ours are round and have 95 % intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(max(0.6 * len(rows) + 2.0, 6.5), 4.6), layout="constrained")
    ax = figure.subplots()
    for i, column in enumerate(columns):
        shift = _SPREAD * (i - (len(columns) - 1) / 2)
        if column.measured:
            _draw_measured(ax, column, shift)
        else:
            places = [place + shift for place in range(len(rows))]
            recalls = [each for each in column.recalls if each is not None]
            ax.plot(places, recalls, "D", color=_SHADES[i], label=column.label)
    ax.set_xticks(range(len(rows)), rows, rotation=30 if len(rows) > 6 else 0)
    ax.set_xlim(-0.6, len(rows) - 0.4)
    ax.set_ylim(0.0, 1.03)
    ax.set_ylabel("recall (ours with 95 % interval)")
    ax.grid(axis="y", alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right upper", frameon=False, fontsize=8)
    ax.set_title(title, fontsize=10)
    figure.supxlabel(textwrap.fill(note, 110), fontsize=7, x=0.01, ha="left")
    return figure


def _draw_measured(ax: "Axes", column: RecallColumn, shift: float) -> None:
    found = [
        (place + shift, recall, recall - ends[0], ends[1] - recall)
        for place, (recall, ends) in enumerate(zip(column.recalls, column.intervals, strict=True))
        if recall is not None and ends is not None
    ]
    places, recalls, below, above = zip(*found, strict=True)
    ax.errorbar(places, recalls, (below, above), fmt="o", capsize=3, label=column.label)
