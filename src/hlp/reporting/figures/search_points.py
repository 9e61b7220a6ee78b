"""The trials of a search: recall against time, with the limit, the best trial and the front."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.trade_off import draw_front
from hlp.reporting.pareto import pareto_front

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WITHIN, _OVER, _BEST = "#0072b2", "#999999", "#d55e00"


def write_search_figure(folder: Path, result: Mapping[str, Any]) -> list[Path]:
    """Write search.png and search.svg of what `search.json` holds; none without any result."""
    if all(each["error"] is not None for each in result["trials"]):
        return []
    return save_figure(search_points(result), folder / "search")


def search_points(result: Mapping[str, Any]) -> "Figure":
    """A point for each trial that has a result; the first is the unchanged configuration."""
    from matplotlib.figure import Figure

    limit, best = result["limit_ms"], result["best"]
    trials = [each for each in result["trials"] if each["error"] is None]
    times, recalls = [t["time_ms"] for t in trials], [t["recall"] for t in trials]
    end = 1.1 * max(*times, limit)
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    ax = figure.subplots()
    ax.axvline(limit, color="0.2", linewidth=1, linestyle=":", label=f"limit {limit:g} ms")
    draw_front(ax, [(times[i], recalls[i]) for i in pareto_front(times, recalls)], end)
    colors = [_WITHIN if time <= limit else _OVER for time in times]
    ax.scatter(times, recalls, 26, colors, zorder=3)
    if best is not None:
        words = f"best within the limit: trial {best['trial']}"
        ax.plot(best["time_ms"], best["recall"], "*", color=_BEST, markersize=14, zorder=4,
                label=words)  # fmt: skip
    first = next((each for each in trials if each["trial"] == 0), None)
    if first is not None:
        ax.annotate("unchanged configuration", (first["time_ms"], first["recall"]), (8, -12),
                    textcoords="offset points", fontsize=8)  # fmt: skip
    ax.set_xlim(0, end)
    ax.set_xlabel("ms for one object in one frame, all stages (median)")
    ax.set_ylabel("ADD(-S) recall")
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    ax.margins(y=0.12)
    ax.set_title(f"{len(trials)} trials of {result['space']}")
    return figure
