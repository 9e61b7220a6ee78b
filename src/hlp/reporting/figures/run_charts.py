"""The charts of one run's page, from its summary and its scored targets."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.records import MILLIMETRES_PER_METRE
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.paper_results import ADD_BY_OBJECT
from hlp.results.intervals import wilson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours that the colour-blind tell apart too (Okabe and Ito, 2008).
_BLUE, _ORANGE, _SKY, _GREY = "#0072b2", "#e69f00", "#56b4e9", "#8a8f98"
_WIDTH, _ROW = 5.4, 0.25  # inches; of a horizontal bar
_BINS = 24
_AD_END, _AD_LIMIT = 0.2, 0.1  # of the diameter

Targets = Sequence[ScoredTarget]


def object_bars(summary: Mapping[str, Any]) -> "Figure":
    """ADD(-S) recall of each object with its 95 % interval; the paper's as a diamond."""
    scores = summary["per_object"]
    rows = range(len(scores))
    recalls = [score["add"]["recall"] for score in scores.values()]
    ax = _bars(list(scores), recalls, [f"{recall:.3f}" for recall in recalls], _SKY)
    for row, score in enumerate(scores.values()):
        if "ci95" in score["add"]:  # older runs have none
            ax.hlines(row + 0.2, *score["add"]["ci95"], color="#222222", linewidth=1.2)
    if all(name in ADD_BY_OBJECT for name in scores):
        published = [ADD_BY_OBJECT[name] for name in scores]
        ax.plot(published, rows, "D", color="black", markerfacecolor="white", markersize=5)
    ax.set(xlabel="ADD(-S) recall, 95 % interval", xlim=(0.0, 1.02))
    return _figure(ax)


def ad_curve(targets: Targets, diameters_mm: Mapping[str, float]) -> "Figure | None":
    """Share of targets whose ADD(-S) is below a threshold of 0 to 20 % of the diameter.

    The thick line is all targets, the thin ones are objects. None without the diameters.
    """
    groups: dict[str, list[float]] = {}
    for target in targets:
        if target.name in diameters_mm:
            error = target.score.add_error * MILLIMETRES_PER_METRE / diameters_mm[target.name]
            groups.setdefault(target.name, []).append(error)
    if not groups:
        return None
    ax = _axes(3.0)
    thresholds = np.linspace(0, _AD_END, 81)

    def draw(errors: Sequence[float], **style: Any) -> None:
        shares = (np.array(errors) < thresholds[:, None]).mean(axis=1)
        ax.plot(100 * thresholds, shares, **style)

    ax.axvline(100 * _AD_LIMIT, color="0.35", linewidth=1, linestyle="--")
    for name, errors in groups.items():
        draw(errors, color="#b9c0ca", linewidth=1, label=name)
    everything = [error for errors in groups.values() for error in errors]
    draw(everything, color=_BLUE, linewidth=2.5, label="all targets")
    ax.set(xlabel="threshold, % of the diameter", ylabel="recall")
    ax.set(xlim=(0.0, 100 * _AD_END), ylim=(0.0, 1.02))
    return _figure(ax)


def error_histogram(targets: Targets, kind: str) -> "Figure":
    """Targets by their error: `translation` (mm) or `rotation` (degrees), right ones and wrong.

    The last bar holds everything beyond the axis. Targets without a pose are left out.
    """
    found = [target.score for target in targets if target.score.found]
    if kind == "translation":
        errors = [MILLIMETRES_PER_METRE * score.translation_error for score in found]
        end, label = 40.0, "translation error, mm"
    else:
        errors = [math.degrees(score.rotation_error) for score in found]
        end, label = 30.0, "rotation error, degrees"
    step = end / _BINS
    places = np.minimum(np.array(errors) / step, _BINS + 0.5).astype(int)
    right = np.array([score.add_correct for score in found], dtype=bool)
    ax = _axes(2.5)
    left = step * (np.arange(_BINS + 1) + 0.5 * (np.arange(_BINS + 1) == _BINS))
    bottom = np.zeros(_BINS + 1, dtype=int)
    for mask, color, name in ((right, _BLUE, "right"), (~right, _ORANGE, "wrong")):
        counts = np.bincount(places[mask], minlength=_BINS + 1)
        ax.bar(left, counts, 0.92 * step, bottom, align="edge", color=color, label=name)
        bottom += counts
    marks = np.arange(0.0, end, 10.0)
    ax.set_xticks([*marks, end + step], [*(f"{mark:g}" for mark in marks), "more"])
    ax.set(xlabel=label, ylabel="targets")
    return _figure(ax)


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
    ax = _axes(2.7)
    for tenth, verdicts in sorted(groups.items()):
        recall, middle = float(np.mean(verdicts)), (tenth + 0.5) / 10
        ax.bar(middle, recall, 0.08, color=_SKY)
        ax.vlines(middle, *wilson(recall, len(verdicts)), color="#222222", linewidth=1.5)
        ax.text(middle, 0.01, str(len(verdicts)), ha="center", fontsize=8)
    ax.set(xlabel="visible fraction (numbers: targets)", ylabel="ADD(-S) recall")
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.02), xticks=np.arange(11) / 10)
    return _figure(ax)


def timing_bars(summary: Mapping[str, Any]) -> "Figure | None":
    """Median and 95th percentile of each stage's time for one object in one frame (ms)."""
    times = {k: v for k, v in summary["timing_ms"].items() if v.get("median") is not None}
    if not times:
        return None
    medians = [time["median"] for time in times.values()]
    words = [
        f"{time['median']:.3g}" + ("" if time["p95"] is None else f" ({time['p95']:.0f})")
        for time in times.values()
    ]
    colors = ["#444444" if name == "total" else _SKY for name in times]
    ax = _bars(list(times), medians, words, colors, beyond=True)
    ax.set_xlabel("ms for one object in one frame, median (95th percentile)")
    ax.set_xlim(0.0, 1.45 * max(medians) or 1.0)
    return _figure(ax)


def _axes(height: float) -> "Axes":
    from matplotlib.figure import Figure

    ax = Figure(figsize=(_WIDTH, height), layout="constrained").subplots()
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=8)
    return ax


def _bars(
    names: Sequence[str],
    values: Sequence[float],
    words: Sequence[str],
    colors: str | Sequence[str],
    beyond: bool = False,
) -> "Axes":
    """A named horizontal bar for each value, the first at the top, with words in or beyond it."""
    ax = _axes(_ROW * len(names) + 0.6)
    ax.barh(range(len(names)), values, 0.64, color=colors)
    for row, text in enumerate(words):
        at = (values[row] if beyond else 0.0, row)
        ax.annotate(text, at, (4, 0), textcoords="offset points", va="center", fontsize=8)
    ax.set_yticks(range(len(names)), [n if len(n) <= 20 else f"{n[:19]}…" for n in names])
    ax.invert_yaxis()
    ax.grid(visible=False)
    return ax


def _figure(ax: "Axes") -> "Figure":
    """Its figure, with labels of one size."""
    ax.xaxis.label.set_fontsize(9)
    ax.yaxis.label.set_fontsize(9)
    figure = ax.get_figure(root=True)
    assert figure is not None
    return figure
