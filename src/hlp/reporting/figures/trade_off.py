"""Recall against time for the runs of a sweep, and figures of points with intervals."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.files import write_csv
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.results import Result, read_results
from hlp.reporting.tables.paper_tables import RecallColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BUDGET = "refinement.budget_ms"
_NAME = "recall_by_time"
_COLUMNS = ("targets", "add_recall", "ci95_low", "ci95_high", "median_ms", "p95_ms", "pareto")
FRONT = "Pareto front"
_NO_LIMIT = "no limit"
_NEAR = 0.05  # of the longest time: labels closer than this are merged


def draw_trade_off(folder: Path) -> list[Path]:
    """Write recall_by_time.csv, .png and .svg of a sweep's finished runs; those files.

    Empty if fewer than two runs are finished.
    """
    found = read_results(folder)
    if len(found.results) < 2:
        return []
    table = folder / f"{_NAME}.csv"
    keys = [key for key in found.swept if any(key in run.chosen for run in found.results)]
    rows, front = [], _front(found.results)
    for place, run in enumerate(found.results):
        times = run.total_ms["median"], run.total_ms["p95"]
        numbers = (run.targets, run.add["recall"], *run.add["ci95"], *times, int(place in front))
        rows.append([*(run.chosen.get(key, "") for key in keys), *numbers])
    write_csv(table, [*keys, *_COLUMNS], rows)
    return [table, *save_figure(recall_by_time(found.results, found.swept), folder / _NAME)]


def recall_by_time(runs: Sequence[Result], swept: Sequence[str]) -> "Figure":
    """A point for each run, with the 95 % interval of its recall; filled on the Pareto front.

    Runs that differ only in their time budget are joined by a line and labelled with the budget.
    The front is a step: the highest recall of all runs that take no longer.
    """
    from matplotlib.figure import Figure

    series: dict[str, list[Result]] = {}
    for run in runs:
        others = {key: run.chosen[key] for key in swept if key in run.chosen and key != BUDGET}
        series.setdefault(_describe(others), []).append(run)
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    ax = figure.subplots()
    longest = max(run.total_ms["median"] for run in runs)
    best = [runs[i] for i in _front(runs)]
    for name, members in series.items():
        members = sorted(members, key=lambda run: run.total_ms["median"])
        times = [run.total_ms["median"] for run in members]
        recalls = [run.add["recall"] for run in members]
        lows = [run.add["recall"] - run.add["ci95"][0] for run in members]
        highs = [run.add["ci95"][1] - run.add["recall"] for run in members]
        drawn = ax.errorbar(
            times, recalls, (lows, highs), marker="o", capsize=3, label=name or None
        )
        beaten = [i for i, run in enumerate(members) if run not in best]
        ax.plot([times[i] for i in beaten], [recalls[i] for i in beaten], "o", zorder=5,
                color=drawn[0].get_color(), markerfacecolor="white")  # fmt: skip
        if BUDGET in swept:
            for text, time, recall in _budget_labels(members, longest):
                at = time, recall
                ax.annotate(text, at, (6, -4), textcoords="offset points", fontsize=8, va="top")
    draw_front(ax, [(run.total_ms["median"], run.add["recall"]) for run in best], 1.15 * longest)
    ax.set_xlabel("ms for one object in one frame, all stages (median)")
    ax.set_ylabel("ADD(-S) recall")
    ax.set_xlim(0, 1.15 * longest)  # room for the last label
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, loc="lower right")
    ax.set_title(f"Recall against time, {runs[0].targets} targets")
    return figure


def draw_front(ax: "Axes", front: Sequence[tuple[float, float]], end: float) -> None:
    """The front's points (time, recall) as a step that goes on to the time `end`."""
    times, recalls = zip(*front, (end, front[-1][1]), strict=True)
    ax.step(times, recalls, where="post", color="0.45", linestyle="--", linewidth=1, label=FRONT)


def _front(runs: Sequence[Result]) -> list[int]:
    return pareto_front(
        [run.total_ms["median"] for run in runs], [run.add["recall"] for run in runs]
    )


def _budget_labels(runs: Sequence[Result], longest: float) -> list[tuple[str, float, float]]:
    """Labels with their time and recall, for runs in order of time; near runs share a label."""
    labels: list[tuple[str, float, float]] = []
    for run in runs:
        if BUDGET not in run.chosen:
            continue
        value, time = float(run.chosen[BUDGET]), float(run.total_ms["median"])
        text = f"{value:g} ms" if value else _NO_LIMIT
        if labels and time - labels[-1][1] < _NEAR * longest:
            others, first_time, recall = labels.pop()
            labels.append((f"{others}\n{text}", first_time, min(recall, run.add["recall"])))
        else:
            labels.append((text, time, run.add["recall"]))
    return labels


def _describe(values: Mapping[str, str]) -> str:
    return ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in values.items())


def draw_calibration(folder: Path, calibration: Mapping[str, Any]) -> None:
    """Write calibration.png and calibration.svg; nothing without any answer.

    `calibration` is the part of that name in `summary.json`.
    """
    if calibration["answers"]:
        save_figure(calibration_figure(calibration), folder / "calibration")


def calibration_figure(calibration: Mapping[str, Any]) -> "Figure":
    """Left: how often answers of about one score are right. Right: risk by coverage."""
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


def pareto_front(times: Sequence[float], recalls: Sequence[float]) -> list[int]:
    """Places of the points on the front, from the fastest to the one with the highest recall.

    A point is left out if another one is at least as fast and at least as good, and better in one
    of the two. Equal points stand on the front together.
    """
    front: list[int] = []
    for place in sorted(range(len(times)), key=lambda i: (times[i], -recalls[i])):
        better = not front or recalls[place] > recalls[front[-1]]
        point = times[place], recalls[place]
        if better or point == (times[front[-1]], recalls[front[-1]]):
            front.append(place)
    return front
