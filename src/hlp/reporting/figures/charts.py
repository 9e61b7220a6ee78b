"""Charts of recalls, errors, times and scores: of one run, of the runs of a sweep, of a search."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.files import write_csv
from hlp.records import MILLIMETRES_PER_METRE
from hlp.reporting.comparison import ScoredTarget
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import STAGE_COLORS, Bar, Panel, draw_bars, loads_in_words
from hlp.reporting.results import Result
from hlp.reporting.summary_tables import run_cells
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
    for stage, time in times.items():
        median, high = time["median"], time["p95"]
        words = f"{median:.3g}" if median < 1000 else f"{median:.0f}"
        words = words if high is None else f"{words} ({high:.0f})"
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
    scores: Mapping[TargetKey, ScoredTarget], scenes: Mapping[TargetKey, Mapping[str, Any]]
) -> "Figure | None":
    """A point for each target that has a pose and a scene: its ADD(-S) by its distance (m)."""
    found = [
        (float(np.linalg.norm(scene["truth"][3:12:4])), score.add_error, score.add_correct)
        for key, scene in scenes.items()
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


BUDGET = "refinement.budget_ms"
FRONT = "Pareto front"
_NAME = "recall_by_time"
_COLUMNS = (
    "targets", "add_recall", "ci95_low", "ci95_high", "median_ms", "p95_ms", "load", "pareto",
)  # fmt: skip
_NEAR = 0.05  # of the longest time: labels closer than this are merged

Point = tuple[float, float]
"""Time (ms) and recall."""


def draw_trade_off(folder: Path, runs: Sequence[Result], swept: Sequence[str]) -> list[Path]:
    """Write recall_by_time.csv, .png and .svg of a sweep's finished runs; those files.

    Empty if fewer than two runs are finished.
    """
    if len(runs) < 2:
        return []
    table = folder / f"{_NAME}.csv"
    keys = [key for key in swept if any(key in run.chosen for run in runs)]
    front, rows = pareto_front([_point(run) for run in runs]), []
    for place, run in enumerate(runs):
        times = run.total_ms["median"], run.total_ms["p95"], run_cells(run.summary)["load"]
        numbers = (run.targets, run.add["recall"], *run.add["ci95"], *times, int(place in front))
        rows.append([*(run.chosen.get(key, "") for key in keys), *numbers])
    write_csv(table, [*keys, *_COLUMNS], rows)
    return [table, *save_figure(recall_by_time(runs, swept), folder / _NAME)]


def _point(run: Result) -> Point:
    return run.total_ms["median"], run.add["recall"]


def time_axes(points: Sequence[Point], end: float, title: str) -> tuple["Figure", "Axes"]:
    """Axes of recall and time from 0 to `end`, with the front of the points as a step."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    ax = figure.subplots()
    front = [points[place] for place in pareto_front(points)]
    times, recalls = zip(*front, (end, front[-1][1]), strict=True)
    ax.step(times, recalls, where="post", color="0.45", linestyle="--", linewidth=1, label=FRONT)
    ax.set(xlabel="ms for one object in one frame, all stages (median)", ylabel="ADD(-S) recall")
    ax.set(xlim=(0, end), title=title)
    ax.grid(alpha=0.3)
    ax.margins(y=0.12)
    ax.spines[["top", "right"]].set_visible(False)
    return figure, ax


def recall_by_time(runs: Sequence[Result], swept: Sequence[str]) -> "Figure":
    """A point for each run, with the 95 % interval of its recall; filled on the Pareto front.

    Runs that differ only in their time budget are joined by a line and labelled with the budget.
    The front is a step: the highest recall of all runs that take no longer.
    """
    series: dict[str, list[Result]] = {}
    for run in sorted(runs, key=_point):
        series.setdefault(run.in_words([key for key in swept if key != BUDGET]), []).append(run)
    points, loads = [_point(run) for run in runs], loads_in_words([run.summary for run in runs])
    longest = max(time for time, _ in points)
    title = f"Recall against time, {runs[0].targets} targets"
    figure, ax = time_axes(points, 1.15 * longest, title)  # room for the last label
    best = [points[place] for place in pareto_front(points)]
    for name, members in series.items():
        times, recalls = zip(*map(_point, members), strict=True)
        below = [run.add["recall"] - run.add["ci95"][0] for run in members]
        above = [run.add["ci95"][1] - run.add["recall"] for run in members]
        label = name + "".join(loads[runs.index(run)] for run in members)
        drawn = ax.errorbar(times, recalls, (below, above), marker="o", capsize=3,
                            label=label or None)  # fmt: skip
        beaten = [_point(run) for run in members if _point(run) not in best]
        ax.plot([time for time, _ in beaten], [recall for _, recall in beaten], "o", zorder=5,
                color=drawn[0].get_color(), markerfacecolor="white")  # fmt: skip
        for text, at in _budget_labels(members, longest) if BUDGET in swept else ():
            ax.annotate(text, at, (6, -4), textcoords="offset points", fontsize=8, va="top")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


def _budget_labels(runs: Sequence[Result], longest: float) -> list[tuple[str, Point]]:
    """Labels with their places, for runs in order of time; near runs share a label."""
    labels: list[tuple[str, Point]] = []
    for run in runs:
        if BUDGET not in run.chosen:
            continue
        value, (time, recall) = run.chosen[BUDGET], _point(run)
        text = "no limit" if value == "null" else f"{float(value):g} ms"
        if labels and time - labels[-1][1][0] < _NEAR * longest:
            others, (first_time, lowest) = labels.pop()
            labels.append((f"{others}\n{text}", (first_time, min(lowest, recall))))
        else:
            labels.append((text, (time, recall)))
    return labels


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
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
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
