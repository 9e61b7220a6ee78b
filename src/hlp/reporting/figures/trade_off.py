"""What the arms of a sweep reach in what time: recall against milliseconds."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SWEEP = "sweep.json"
"""Of a sweep's folder: what was swept; its arms lie in folders 0, 1, … beside it."""
BUDGET = "refinement.budget_ms"
_NAME = "recall_by_time"
_COLUMNS = ("targets", "add_recall", "ci95_low", "ci95_high", "median_ms", "p95_ms")
_NO_LIMIT = "no limit"
_NEAR = 0.05  # of the longest time


@dataclass(frozen=True)
class ArmReached:
    """One arm: what it has for the swept keys, AD recall with its interval, time (ms) a target."""

    values: Mapping[str, str]
    targets: int
    recall: float
    interval: tuple[float, float]
    median_ms: float
    p95_ms: float


def draw_trade_off(folder: Path) -> list[Path]:
    """Write recall_by_time.csv, .png and .svg of a sweep's finished arms; those files.

    Empty where fewer than two arms have a summary. Times are those of all stages as they were made:
    a stage that the arms share counts with the same time in all of them.
    """
    import matplotlib

    arms = read_arms(folder)
    if len(arms) < 2:
        return []
    files = [folder / f"{_NAME}.{ending}" for ending in ("csv", "png", "svg")]
    _write_csv(files[0], arms)
    figure = recall_by_time(arms)
    with matplotlib.rc_context({"svg.hashsalt": "hlp"}):  # equal figures, equal files
        figure.savefig(files[1], dpi=150)
        figure.savefig(files[2], metadata={"Date": None})
    return files


def read_arms(folder: Path) -> list[ArmReached]:
    """The arms of a sweep that have a summary, in their order."""
    swept = json.loads((folder / SWEEP).read_text())["swept"]
    arms = []
    for path in sorted(folder.glob("*/summary.json"), key=lambda path: path.parent.name.zfill(9)):
        summary = json.loads(path.read_text())
        total, add = summary["timing_ms"]["total"], summary["metrics"]["add"]
        given = yaml.safe_load((path.parent / ".hydra" / "overrides.yaml").read_text())
        pairs = dict(override.lstrip("+").split("=", 1) for override in given)
        values = {key: pairs[key] for key in swept if key in pairs}
        low, high = add["ci95"]
        found = (summary["targets"], add["recall"], (low, high), total["median"], total["p95"])
        arms.append(ArmReached(values, *found))
    return arms


def recall_by_time(arms: Sequence[ArmReached]) -> "Figure":
    """A point an arm, with the 95 % interval of its recall.

    Arms that differ in their budget alone are joined by a line, and labelled with it.
    """
    from matplotlib.figure import Figure

    series: dict[str, list[ArmReached]] = {}
    for arm in arms:
        rest = {key: value for key, value in arm.values.items() if key != BUDGET}
        series.setdefault(_words(rest), []).append(arm)
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    ax = figure.subplots()
    latest = max(arm.median_ms for arm in arms)
    for name, own in series.items():
        own = sorted(own, key=lambda arm: arm.median_ms)
        times, recalls = [arm.median_ms for arm in own], [arm.recall for arm in own]
        lows = [arm.recall - arm.interval[0] for arm in own]
        highs = [arm.interval[1] - arm.recall for arm in own]
        ax.errorbar(times, recalls, (lows, highs), marker="o", capsize=3, label=name)
        for text, time, recall in _budgets([arm for arm in own if BUDGET in arm.values], latest):
            at = time, recall
            ax.annotate(text, at, (6, -4), textcoords="offset points", fontsize=8, va="top")
    ax.set_xlabel("ms for one object in one frame, all stages (median)")
    ax.set_ylabel("AD recall")
    ax.set_xlim(0, 1.15 * latest)  # room for the last label
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    if any(series):
        ax.legend(frameon=False)
    ax.set_title(f"Recall against time, {arms[0].targets} targets")
    return figure


def _budgets(arms: Sequence[ArmReached], latest: float) -> list[tuple[str, float, float]]:
    """Labels, each with its time and recall, of arms in order of time; near ones share one."""
    labels: list[tuple[str, float, float]] = []
    for arm in arms:
        value = float(arm.values[BUDGET])
        text = f"{value:g} ms" if value else _NO_LIMIT
        if labels and arm.median_ms - labels[-1][1] < _NEAR * latest:
            others, time, recall = labels.pop()
            labels.append((f"{others}\n{text}", time, min(recall, arm.recall)))
        else:
            labels.append((text, arm.median_ms, arm.recall))
    return labels


def _words(values: Mapping[str, str]) -> str:
    return ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in values.items())


def _write_csv(path: Path, arms: Sequence[ArmReached]) -> None:
    keys = list(dict.fromkeys(key for arm in arms for key in arm.values))
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*keys, *_COLUMNS])
        for arm in arms:
            values = [arm.values.get(key, "") for key in keys]
            numbers = (arm.targets, arm.recall, *arm.interval, arm.median_ms, arm.p95_ms)
            writer.writerow([*values, *numbers])
