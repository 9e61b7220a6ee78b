"""Charts of recalls, errors, times and scores: of one run, of the runs of a sweep, of a search."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.arrays import grouped
from hlp.records import MILLIMETRES_PER_METRE
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.figures import new_figure
from hlp.reporting.figures.bars import STAGE_COLORS, Bar, Panel, draw_bars, loads_in_words
from hlp.reporting.results import Result
from hlp.reporting.study_tables import format_ms
from hlp.results.recalls import TargetKey, wilson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BLUE, _ORANGE = "#0072b2", "#e69f00"
_AD_END, _AD_LIMIT = 20.0, 10.0  # % of the diameter
_BINS = 24

Targets = Sequence[ScoredTarget]


def visibility_bars(targets: Targets) -> "Figure | None":
    """ADD(-S) recall in tenths of the visible fraction with Wilson's 95 % interval.

    None if the data set states no visible fraction.
    """
    known = [t.score for t in targets if not math.isnan(t.score.visible_fraction)]
    if not known:
        return None
    tenths = grouped(known, lambda score: min(int(10 * score.visible_fraction), 9))
    rows, bars = [], []
    for tenth, own in sorted(tenths.items()):
        recall = float(np.mean([score.add_correct for score in own]))
        rows.append(f"{tenth / 10:.1f} to {(tenth + 1) / 10:.1f} ({len(own)})")
        bars.append(Bar(recall, f"{recall:.3f}", wilson(recall, len(own))))
    title = "ADD(-S) recall by visible fraction (targets), 95 % interval"
    return draw_bars(rows, [Panel(title, {"": bars}, recall=True)], "")


def timing_bars(summary: Mapping[str, Any]) -> "Figure | None":
    """Median and 95th percentile of each stage's time for one object in one frame (ms)."""
    times = {k: v for k, v in summary["timing_ms"].items() if v["median"] is not None}
    if not times:
        return None
    bars = []
    for stage, time in times.items():
        median, high = time["median"], time["p95"]
        words = format_ms(median) if high is None else f"{format_ms(median)} ({format_ms(high)})"
        bars.append(Bar(median, words, color=STAGE_COLORS.get(stage, "#444444")))
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


def bop_curves(targets: Targets) -> "Figure | None":
    """Share of targets below each of BOP's thresholds of MSSD and MSPD; None if not computed.

    A target's mean recall says how many of the ten it keeps to: the widest ones.
    """
    figure, ax = _figure(3.0)
    for name, color in (("mssd", _BLUE), ("mspd", _ORANGE)):
        kept = np.array([10 * getattr(target.score, f"{name}_recall") for target in targets])
        if np.isnan(kept).any():
            return None
        shares = [float((kept.round() > 10 - place).mean()) for place in range(1, 11)]
        ax.plot(range(5, 51, 5), shares, "o-", color=color, label=name.upper())
    ax.set(xlabel="threshold: MSSD, % of the diameter; MSPD, px of 640", ylabel="recall")
    ax.set(xlim=(0.0, 52.0), ylim=(0.0, 1.02))
    ax.legend(frameon=False, loc="lower right")
    return figure


def error_by_distance(
    scores: Mapping[TargetKey, ScoredTarget], truths: Mapping[TargetKey, Sequence[float]]
) -> "Figure | None":
    """A point for each target that has a pose and a true one: its ADD(-S) by its distance (m)."""
    found = [
        (float(np.linalg.norm(truth[3:12:4])), score.add_error, score.add_correct)
        for key, truth in truths.items()
        if key in scores and (score := scores[key].score).found
    ]
    if not found:
        return None
    figure, ax = _figure(2.5)
    millimetres, errors, right = map(np.array, zip(*found, strict=True))
    colors = [_BLUE if verdict else _ORANGE for verdict in right]
    ax.scatter(millimetres / MILLIMETRES_PER_METRE, MILLIMETRES_PER_METRE * errors, 26, colors)
    ax.set(xlabel="distance from the camera, m", ylabel="ADD(-S), mm", yscale="log")
    return figure


def _figure(height: float, width: float = 6.0) -> tuple["Figure", "Axes"]:
    figure = new_figure(width, height)
    ax = figure.subplots()
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)
    ax.set_axisbelow(True)
    return figure, ax


FRONT = "Pareto front"
Point = tuple[float, float]
"""Time (ms) and recall."""


def _time_axes(points: Sequence[Point], end: float, title: str) -> tuple["Figure", "Axes"]:
    """Axes of recall and time from 0 to `end`, with the front of the points as a step."""
    figure, ax = _figure(4.6, 7.0)
    front = [points[place] for place in pareto_front(points)]
    times, recalls = zip(*front, (end, front[-1][1]), strict=True)
    ax.step(times, recalls, where="post", color="0.45", linestyle="--", linewidth=1, label=FRONT)
    ax.set(xlabel="ms for one object in one frame, all stages (median)", ylabel="ADD(-S) recall")
    ax.set(xlim=(0, end), title=title)
    ax.margins(y=0.12)
    return figure, ax


def recall_by_time(runs: Sequence[Result], swept: Sequence[str]) -> "Figure":
    """A point for each run, with the 95 % interval of its recall; filled on the Pareto front.

    The front is a step: the highest recall of all runs that take no longer.
    """
    points = [(run.total_ms["median"], run.add["recall"]) for run in runs]
    longest, front = max(time for time, _ in points), pareto_front(points)
    title = f"Recall against time, {runs[0].targets} targets"
    figure, ax = _time_axes(points, 1.05 * longest, title)
    loads = loads_in_words([run.summary for run in runs])
    for place, ((time, recall), run, load) in enumerate(zip(points, runs, loads, strict=True)):
        low, high = run.add["ci95"]
        ax.errorbar(time, recall, [[recall - low], [high - recall]], fmt="o", capsize=3,
                    markerfacecolor=None if place in front else "white",
                    label=f"{run.in_words(swept)}{load}" or None)  # fmt: skip
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


def search_points(result: Mapping[str, Any]) -> "Figure":
    """A point for each trial with a result, of what `search.json` holds; there must be one."""
    limit, best = result["limit_ms"], result["best"]
    trials = [trial for trial in result["trials"] if trial["error"] is None]
    points = [(trial["time_ms"], trial["recall"]) for trial in trials]
    end = 1.1 * max(limit, *(time for time, _ in points))
    figure, ax = _time_axes(points, end, f"{len(trials)} trials of {result['space']}")
    ax.axvline(limit, color="0.2", linewidth=1, linestyle=":", label=f"limit {limit:g} ms")
    colors = [_BLUE if time <= limit else "#999999" for time, _ in points]
    times, recalls = zip(*points, strict=True)
    ax.scatter(times, recalls, 26, colors, zorder=3)
    if best is not None:
        ax.plot(best["time_ms"], best["recall"], "*", color="#d55e00", markersize=14, zorder=4,
                label=f"best within the limit: trial {best['trial']}")  # fmt: skip
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


def pareto_front(points: Sequence[Point]) -> list[int]:
    """Places of the points on the front, from the fastest to the one with the highest recall.

    A point is left out if another one is at least as fast and at least as good, and better in one
    of the two. Equal points stand on the front together.
    """
    front: list[int] = []
    for place in sorted(range(len(points)), key=lambda i: (points[i][0], -points[i][1])):
        highest = points[front[-1]] if front else None
        if highest is None or points[place][1] > highest[1] or points[place] == highest:
            front.append(place)
    return front


def calibration_figure(calibration: Mapping[str, Any]) -> "Figure":
    """Left: how often answers of about one score are right. Right: risk by coverage.

    `calibration` is the part of that name in `summary.json`, of one or more answers.
    """
    figure = new_figure(8.0, 3.8)
    left, right = figure.subplots(1, 2)
    most = max(row[0] for row in calibration["reliability"])
    left.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for count, score, share in calibration["reliability"]:
        left.plot(score, share, "o", color="tab:blue", markersize=3 + 9 * (count / most) ** 0.5)
    left.set(xlabel="mean score", ylabel="share of right answers", xlim=(0, 1), ylim=(0, 1.02))
    left.set_title(f"expected calibration error {calibration['ece']:.3f}")
    coverage, risk = zip(*calibration["risk_coverage"], strict=True)
    right.step(coverage, risk, where="post", color="tab:red")
    right.set(xlabel="coverage", ylabel="risk: share of wrong answers", xlim=(0, 1))
    right.set_ylim(0, max(0.05, 1.1 * max(risk)))
    right.set_title(f"area under the curve {calibration['aurc']:.4f}")
    figure.suptitle(f"{calibration['answers']} answers; right: ADD-S < 10 % of the diameter")
    return figure
