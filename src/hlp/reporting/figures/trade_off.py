"""Recall against time for the runs of a sweep."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.files import write_csv
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.pareto import pareto_front
from hlp.reporting.results import Result, read_results

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
