"""The charts of one run's page, from its summary and its scored targets."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.records import MILLIMETRES_PER_METRE
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.figures.bars import Bar, Panel, draw_bars, recall_bar
from hlp.reporting.tables.summary_tables import paper_recalls
from hlp.results.intervals import wilson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BLUE, _ORANGE = "#0072b2", "#e69f00"
_AD_END, _AD_LIMIT = 20.0, 10.0  # % of the diameter
_BINS = 24

Targets = Sequence[ScoredTarget]


def object_bars(summary: Mapping[str, Any]) -> "Figure":
    """ADD(-S) recall of each object with its 95 % interval; the paper's as a diamond."""
    scores = summary["per_object"]
    bars = [recall_bar(score["add"]) for score in scores.values()]
    paper = paper_recalls([*scores])
    published = {"paper": paper} if paper else {}
    panel = Panel("ADD(-S) recall, 95 % interval", {"ours": bars}, recall=True, published=published)
    return draw_bars(list(scores), [panel], "")


def visibility_bars(targets: Targets) -> "Figure | None":
    """ADD(-S) recall in tenths of the visible fraction with Wilson's 95 % interval.

    None if the data set states no visible fraction.
    """
    groups: dict[int, list[bool]] = {}
    for target in targets:
        visible = target.score.visible_fraction
        if not math.isnan(visible):
            groups.setdefault(min(int(10 * visible), 9), []).append(target.score.add_correct)
    if not groups:
        return None
    rows, bars = [], []
    for tenth, verdicts in sorted(groups.items()):
        recall = float(np.mean(verdicts))
        rows.append(f"{tenth / 10:.1f} to {(tenth + 1) / 10:.1f} ({len(verdicts)})")
        bars.append(Bar(recall, f"{recall:.3f}", wilson(recall, len(verdicts))))
    title = "ADD(-S) recall by visible fraction (targets), 95 % interval"
    return draw_bars(rows, [Panel(title, {"": bars}, recall=True)], "")


def timing_bars(summary: Mapping[str, Any]) -> "Figure | None":
    """Median and 95th percentile of each stage's time for one object in one frame (ms)."""
    times = {k: v for k, v in summary["timing_ms"].items() if v.get("median") is not None}
    if not times:
        return None
    bars = []
    for time in times.values():
        median, high = time["median"], time["p95"]
        words = f"{median:.3g}" if median < 1000 else f"{median:.0f}"
        bars.append(Bar(median, words if high is None else f"{words} ({high:.0f})"))
    title = "ms for one object in one frame, median (95th percentile)"
    return draw_bars(list(times), [Panel(title, {"": bars})], "")


def ad_curve(targets: Targets, diameters_mm: Mapping[str, float]) -> "Figure | None":
    """Share of targets whose ADD(-S) is below a threshold of 0 to 20 % of the diameter.

    The thick line is all targets, the thin ones are objects. None without the diameters.
    """
    groups: dict[str, list[float]] = {}
    for target in targets:
        if target.name in diameters_mm:
            error = 100 * MILLIMETRES_PER_METRE * target.score.add_error
            groups.setdefault(target.name, []).append(error / diameters_mm[target.name])
    if not groups:
        return None
    figure, ax = _figure(3.0)
    thresholds = np.linspace(0, _AD_END, 81)
    everything = [error for errors in groups.values() for error in errors]
    ax.axvline(_AD_LIMIT, color="0.35", linewidth=1, linestyle="--")
    for name, errors in {**groups, "all targets": everything}.items():
        shares = (np.array(errors) < thresholds[:, None]).mean(axis=1)
        style = {"color": _BLUE, "linewidth": 2.5} if errors is everything else {"color": "0.75"}
        ax.plot(thresholds, shares, label=name, **style)
    ax.set(xlabel="threshold, % of the diameter", ylabel="recall")
    ax.set(xlim=(0.0, _AD_END), ylim=(0.0, 1.02))
    return figure


def error_histogram(targets: Targets, kind: str) -> "Figure":
    """Targets by their error: `translation` (mm) or `rotation` (degrees), right ones and wrong.

    The last bar holds everything beyond the axis. Targets without a pose are left out.
    """
    found = [target.score for target in targets if target.score.found]
    if kind == "translation":
        errors = [MILLIMETRES_PER_METRE * score.translation_error for score in found]
        end, unit = 40.0, "mm"
    else:
        errors = [math.degrees(score.rotation_error) for score in found]
        end, unit = 30.0, "degrees"
    within = np.minimum(errors, end)
    right = np.array([score.add_correct for score in found], dtype=bool)
    figure, ax = _figure(2.5)
    ax.hist(
        [within[right], within[~right]],
        np.linspace(0.0, end, _BINS + 1).tolist(),
        stacked=True,
        color=[_BLUE, _ORANGE],
        label=["right", "wrong"],
        rwidth=0.92,
    )
    ax.set(xlabel=f"{kind} error, {unit} (last bar: and more)", ylabel="targets", xlim=(0.0, end))
    return figure


def _figure(height: float) -> tuple["Figure", "Axes"]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, height), layout="constrained")
    ax = figure.subplots()
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)
    ax.set_axisbelow(True)
    return figure, ax
