"""Recall against time, of the runs of a sweep and the trials of a search; calibration of scores."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.files import write_csv
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.results import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BUDGET = "refinement.budget_ms"
FRONT = "Pareto front"
_NAME = "recall_by_time"
_COLUMNS = ("targets", "add_recall", "ci95_low", "ci95_high", "median_ms", "p95_ms", "pareto")
_NEAR = 0.05  # of the longest time: labels closer than this are merged
_WITHIN, _OVER, _BEST = "#0072b2", "#999999", "#d55e00"

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
        times = run.total_ms["median"], run.total_ms["p95"]
        numbers = (run.targets, run.add["recall"], *run.add["ci95"], *times, int(place in front))
        rows.append([*(run.chosen.get(key, "") for key in keys), *numbers])
    write_csv(table, [*keys, *_COLUMNS], rows)
    return [table, *save_figure(recall_by_time(runs, swept), folder / _NAME)]


def _point(run: Result) -> Point:
    return run.total_ms["median"], run.add["recall"]


def _axes(points: Sequence[Point], end: float, title: str) -> tuple["Figure", "Axes"]:
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
        others = [key for key in swept if key in run.chosen and key != BUDGET]
        words = ", ".join(f"{key.rpartition('.')[2]} {run.chosen[key]}" for key in others)
        series.setdefault(words, []).append(run)
    points = [_point(run) for run in runs]
    longest = max(time for time, _ in points)
    title = f"Recall against time, {runs[0].targets} targets"
    figure, ax = _axes(points, 1.15 * longest, title)  # room for the last label
    best = [points[place] for place in pareto_front(points)]
    for name, members in series.items():
        times, recalls = zip(*map(_point, members), strict=True)
        below = [run.add["recall"] - run.add["ci95"][0] for run in members]
        above = [run.add["ci95"][1] - run.add["recall"] for run in members]
        drawn = ax.errorbar(times, recalls, (below, above), marker="o", capsize=3,
                            label=name or None)  # fmt: skip
        beaten = [_point(run) for run in members if _point(run) not in best]
        ax.plot([time for time, _ in beaten], [recall for _, recall in beaten], "o", zorder=5,
                color=drawn[0].get_color(), markerfacecolor="white")  # fmt: skip
        for text, at in _budget_labels(members, longest) if BUDGET in swept else ():
            ax.annotate(text, at, (6, -4), textcoords="offset points", fontsize=8, va="top")
    ax.legend(frameon=False, loc="lower right")
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


def search_points(result: Mapping[str, Any]) -> "Figure":
    """A point for each trial with a result, of what `search.json` holds; there must be one.

    The first is the unchanged configuration.
    """
    limit, best = result["limit_ms"], result["best"]
    trials = [trial for trial in result["trials"] if trial["error"] is None]
    points = [(trial["time_ms"], trial["recall"]) for trial in trials]
    end = 1.1 * max(limit, *(time for time, _ in points))
    figure, ax = _axes(points, end, f"{len(trials)} trials of {result['space']}")
    ax.axvline(limit, color="0.2", linewidth=1, linestyle=":", label=f"limit {limit:g} ms")
    colors = [_WITHIN if time <= limit else _OVER for time, _ in points]
    times, recalls = zip(*points, strict=True)
    ax.scatter(times, recalls, 26, colors, zorder=3)
    if best is not None:
        words = f"best within the limit: trial {best['trial']}"
        ax.plot(best["time_ms"], best["recall"], "*", color=_BEST, markersize=14, zorder=4,
                label=words)  # fmt: skip
    for trial, point in zip(trials, points, strict=True):
        if trial["trial"] == 0:
            ax.annotate("unchanged configuration", point, (8, -12), textcoords="offset points",
                        fontsize=8)  # fmt: skip
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
