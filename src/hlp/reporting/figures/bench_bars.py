"""A bench as a picture: the time of each stage, for each path that was measured."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.sweep_panels import COLORS
from hlp.reporting.tables.bench_table import TIMED, TOTAL, format_ms

if TYPE_CHECKING:
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
