"""Failure waterfall of a run as stacked bars: the share of targets missed, by cause."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.reporting.figures.saving import save_figure
from hlp.reporting.tables.summary_tables import WATERFALL_GROUPS
from hlp.results.summary_file import CORRECT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Counts = Mapping[str, int]

COLORS = {
    "bad_frame": "#000000",
    "depth_missing": "#7f7f7f",
    "no_window": "#c7c7c7",
    "wrong_region": "#8c564b",
    "few_votes": "#1f77b4",
    "outside_basin": "#9ecae1",
    "screening": "#fdd0a2",
    "refiner_diverged": "#e6550d",
    "ranking": "#31a354",
    "symmetric_flip": "#756bb1",
}
"""One colour for each cause, the same in every figure; similar ones for causes of one stage."""


def draw_waterfall(folder: Path, waterfall: Mapping[str, Any]) -> None:
    """Write waterfall.png and waterfall.svg: misses per object and per visible fraction.

    `waterfall` is the part of that name in `summary.json`.
    """
    save_figure(stacked_bars(waterfall), folder / "waterfall")


def stacked_bars(waterfall: Mapping[str, Any]) -> "Figure":
    """One bar for each object and each class of visible fraction: misses stacked by cause."""
    from matplotlib.figure import Figure

    widths = [max(len(waterfall[panel]), 2) for panel in WATERFALL_GROUPS]
    figure = Figure(figsize=(0.85 * sum(widths) + 3.0, 4.2), layout="constrained")
    axes = figure.subplots(1, len(WATERFALL_GROUPS), sharey=True, width_ratios=widths)
    lost = {name: count for name, count in waterfall["total"].items() if name != CORRECT}
    causes = [cause for cause, count in lost.items() if count]
    for ax, (panel, title) in zip(axes, WATERFALL_GROUPS.items(), strict=True):
        _stack(ax, waterfall[panel], causes)
        ax.set_title(f"by {title}")
    axes[0].set_ylabel("share of targets missed by ADD(-S)")
    handles, labels = axes[0].get_legend_handles_labels()
    if causes:
        # The last cause lies on top of the bars, so it comes first.
        figure.legend(handles[::-1], labels[::-1], loc="outside right upper", frameon=False)
    targets = sum(waterfall["total"].values())
    figure.suptitle(f"{sum(lost.values())} of {targets} targets missed, by cause")
    return figure


def _stack(ax: "Axes", groups: Mapping[str, Counts], causes: list[str]) -> None:
    targets = [max(sum(counts.values()), 1) for counts in groups.values()]
    bottom = [0.0] * len(groups)
    for cause in causes:
        shares = [
            counts[cause] / total for counts, total in zip(groups.values(), targets, strict=True)
        ]
        label = cause.replace("_", " ")
        ax.bar(range(len(groups)), shares, 0.7, bottom, color=COLORS.get(cause), label=label)
        bottom = [low + share for low, share in zip(bottom, shares, strict=True)]
    names = [f"{name}\n{total}" for name, total in zip(groups, targets, strict=True)]
    ax.set_xticks(range(len(groups)), names, fontsize=8)
    ax.set_xlim(-0.6, len(groups) - 0.4)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)
    ax.set_axisbelow(True)
