"""A bench as a picture: the time of each stage, for each path that was measured."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Int

from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.sweep_panels import COLORS
from hlp.reporting.tables.bench_table import TIMED, TOTAL, format_ms
from hlp.reporting.tables.summary_tables import WATERFALL_GROUPS
from hlp.results.summary_file import CORRECT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROW = 0.3  # inches
_ROOM = 0.12  # of the axis, beyond the longest bar, for its number
_NARROW = 0.06  # share of the axis below which a stage's number would not fit into its bar


def draw_bench(folder: Path, result: Mapping[str, Any]) -> list[Path]:
    """Write bench.png and bench.svg, given what bench.json holds; those files."""
    return save_figure(bench_bars(result), folder / "bench")


def bench_bars(result: Mapping[str, Any]) -> "Figure":
    """A bar for each path and unit (first object, further one, whole frame), stacked by stage.

    Stages are medians (ms). The number behind a bar is the median of the whole, which need not be
    their sum.
    """
    from matplotlib.figure import Figure

    bars = {
        f"{name}: {TIMED[unit]}": path[unit]
        for name, path in result["paths"].items()
        for unit in TIMED
        if path[unit]
    }
    stages = list(dict.fromkeys(s for bar in bars.values() for s in bar if s.startswith("stage ")))
    longest = max(sum(bar[s]["median_ms"] for s in stages if s in bar) for bar in bars.values())
    figure = Figure(figsize=(7.0, _ROW * len(bars) + 1.3), layout="constrained")
    ax = figure.subplots()
    for row, bar in enumerate(bars.values()):
        left = 0.0
        for stage, color in zip(stages, COLORS, strict=False):
            time = bar[stage]["median_ms"] if stage in bar else 0.0
            ax.barh(row, time, 0.75, left, color=color, label=stage if row == 0 else None)
            if time > _NARROW * longest:
                ax.text(left + time / 2, row, format_ms(time), ha="center", va="center",
                        fontsize=7.5, color="white")  # fmt: skip
            left += time
        ax.annotate(format_ms(bar[TOTAL]["median_ms"]), (left, row), (4, 0), va="center",
                    textcoords="offset points", fontsize=8)  # fmt: skip
    ax.set_yticks(range(len(bars)), list(bars), fontsize=8)
    ax.invert_yaxis()
    ax.set_xlim(0.0, (1.0 + _ROOM) * max(longest, 1.0))
    ax.set_xlabel("ms, medians of first object, further ones, whole frames", fontsize=8)
    ax.tick_params(labelsize=8)
    ax.grid(axis="x", alpha=0.3)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=3, frameon=False, fontsize=8)
    return figure


Counts = Mapping[str, int]

CAUSE_COLORS = {
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
        ax.bar(range(len(groups)), shares, 0.7, bottom, color=CAUSE_COLORS.get(cause), label=label)
        bottom = [low + share for low, share in zip(bottom, shares, strict=True)]
    names = [f"{name}\n{total}" for name, total in zip(groups, targets, strict=True)]
    ax.set_xticks(range(len(groups)), names, fontsize=8)
    ax.set_xlim(-0.6, len(groups) - 0.4)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)
    ax.set_axisbelow(True)


NAME = "confusion"
_CELL = 0.42  # inches
_DARK = 0.55  # of a row, from which its words are white


@dataclass(frozen=True)
class Confusion:
    """Windows by true object (rows) and by the class that the classifier finds most likely."""

    objects: tuple[str, ...]
    classes: tuple[str, ...]
    counts: Int[np.ndarray, "o c"]

    @classmethod
    def of(cls, counts: Mapping[str, Mapping[str, int]]) -> "Confusion":
        """From `window_classes` of `summary.json`.

        Columns are the objects, then what else was said, background last.
        """
        objects = tuple(counts)
        others = dict.fromkeys(said for row in counts.values() for said in row)
        wrong = [said for said in others if said not in objects]
        classes = (*objects, *sorted(wrong, key=lambda said: said == "background"))
        table = [[counts[true].get(said, 0) for said in classes] for true in objects]
        return cls(objects, classes, np.array(table, dtype=np.int64).reshape(len(objects), -1))

    @property
    def right(self) -> int:
        """Windows whose most likely class is their object."""
        return int(np.trace(self.counts))

    @property
    def shares(self) -> np.ndarray:
        """The counts as shares of their rows."""
        return np.asarray(self.counts / np.maximum(self.counts.sum(axis=1, keepdims=True), 1))


def draw_confusion(folder: Path, counts: Mapping[str, Mapping[str, int]]) -> None:
    """Write confusion.png and confusion.svg; nothing without any window.

    `counts` are `window_classes` of `summary.json`.
    """
    if counts:
        save_figure(confusion_figure(Confusion.of(counts)), folder / NAME)


def confusion_figure(found: Confusion) -> "Figure":
    """Numbers of windows, shaded by their share of a row."""
    from matplotlib.figure import Figure

    rows, columns = found.counts.shape
    size = (max(_CELL * columns + 2.2, 5.4), max(_CELL * rows + 2.0, 3.2))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(found.shares, cmap="Blues", vmin=0.0, vmax=1.0)
    for (row, column), count in np.ndenumerate(found.counts):
        if count:
            color = "white" if found.shares[row, column] > _DARK else "black"
            axes.text(column, row, str(count), ha="center", va="center", color=color, fontsize=8)
    axes.set_xticks(range(columns), found.classes, rotation=45, ha="right", fontsize=8)
    axes.set_yticks(range(rows), found.objects, fontsize=8)
    axes.set_xlabel("most likely class of the window")
    axes.set_ylabel("object that it shows")
    total = int(found.counts.sum())
    axes.set_title(f"{found.right} of {total} windows at targets are classified right", fontsize=10)
    return figure
