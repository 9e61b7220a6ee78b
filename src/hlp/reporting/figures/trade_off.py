"""Recall against time for the runs of a sweep."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.files import write_csv
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.results import Result, read_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BUDGET = "refinement.budget_ms"
_NAME = "recall_by_time"
_COLUMNS = ("targets", "add_recall", "ci95_low", "ci95_high", "median_ms", "p95_ms")
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
    rows = []
    for run in found.results:
        numbers = (run.targets, run.add["recall"], *run.add["ci95"], *run.total_ms.values())
        rows.append([*(run.chosen.get(key, "") for key in keys), *numbers])
    write_csv(table, [*keys, *_COLUMNS], rows)
    return [table, *save_figure(recall_by_time(found.results, found.swept), folder / _NAME)]


def recall_by_time(runs: Sequence[Result], swept: Sequence[str]) -> "Figure":
    """A point for each run, with the 95 % interval of its recall.

    Runs that differ only in their time budget are joined by a line and labelled with the budget.
    """
    from matplotlib.figure import Figure

    series: dict[str, list[Result]] = {}
    for run in runs:
        others = {key: run.chosen[key] for key in swept if key in run.chosen and key != BUDGET}
        series.setdefault(_describe(others), []).append(run)
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    ax = figure.subplots()
    longest = max(run.total_ms["median"] for run in runs)
    for name, members in series.items():
        members = sorted(members, key=lambda run: run.total_ms["median"])
        times = [run.total_ms["median"] for run in members]
        recalls = [run.add["recall"] for run in members]
        lows = [run.add["recall"] - run.add["ci95"][0] for run in members]
        highs = [run.add["ci95"][1] - run.add["recall"] for run in members]
        ax.errorbar(times, recalls, (lows, highs), marker="o", capsize=3, label=name)
        if BUDGET in swept:
            for text, time, recall in _budget_labels(members, longest):
                at = time, recall
                ax.annotate(text, at, (6, -4), textcoords="offset points", fontsize=8, va="top")
    ax.set_xlabel("ms for one object in one frame, all stages (median)")
    ax.set_ylabel("ADD(-S) recall")
    ax.set_xlim(0, 1.15 * longest)  # room for the last label
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    if any(series):
        ax.legend(frameon=False)
    ax.set_title(f"Recall against time, {runs[0].targets} targets")
    return figure


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
