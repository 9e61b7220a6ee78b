"""Two runs compared target by target, with interval and test of the difference."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hlp.errors import DataError
from hlp.records import TargetScore
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, check_layout, lay_out, prose
from hlp.results.intervals import (
    blocks_of,
    difference_interval,
    median_difference_interval,
    wilson,
)
from hlp.results.poses_file import read_scores
from hlp.results.summary_file import METRICS, TargetKey, numbered_targets

RESAMPLINGS = 10_000
SEED = 0
CHANGES_SHOWN = 40
_WIDE = ("targets",)  # columns for which a terminal has no room
EXPLAINED = (
    "Recall of run B minus recall of run A over the targets that both have, with the 95 % interval"
    " of the paired bootstrap over blocks of neighbouring frames. p is McNemar's exact two-sided"
    " test on the targets that only one run has right. It assumes that targets are independent, so"
    " the interval is the safer guide."
)
Difference = tuple[float, tuple[float, float]]
"""A difference of two means or medians, and its 95 % interval."""


@dataclass(frozen=True)
class ScoredTarget:
    """One target's score and the name of its object."""

    name: str
    score: TargetScore

    def correct(self, metric: str) -> bool:
        """Verdict of a metric, named as in `summary.json`."""
        return METRICS[metric](self.score)


def compare_runs(first: Path, second: Path, names: tuple[str, str], layout: str) -> str:
    """Tables of the differences between two runs, given their `scores.csv`.

    Raises FileNotFoundError without a file; ValueError for a broken one, for runs that have no
    target in common and for a `layout` that is not `text` or `markdown`.
    """
    check_layout(layout)
    scores = (read_targets(first), read_targets(second))
    shared = sorted(scores[0].keys() & scores[1].keys())
    if not shared:
        raise DataError(f"{names[0]} and {names[1]} have no target in common")
    alone = [len(each) - len(shared) for each in scores]
    parts = [f"A = {names[0]}\nB = {names[1]}", prose(EXPLAINED, layout)]
    only = f"; left out: {alone[0]} targets that only A has, {alone[1]} that only B has"
    counted = f"{len(shared)} targets in common{only if any(alone) else ''}"
    parts.append(prose(counted, layout))
    pairs = [(target, scores[0][target], scores[1][target]) for target in shared]
    for metric, label in METRIC_LABELS.items():
        table = differences_table(pairs, metric)
        shown = table.without(*_WIDE).fitted(0) if layout == "text" else table
        parts.append(f"{label}\n\n{lay_out(shown, layout)}")
    changes = changes_table(pairs)
    if changes.rows:
        few = Table(changes.header, changes.rows[:CHANGES_SHOWN])
        left = len(changes.rows) - len(few.rows)
        more = f"\n… and {left} more" if left else ""
        parts.append(
            f"Changed verdicts of ADD(-S): {len(changes.rows)}\n\n{lay_out(few, layout)}{more}"
        )
    else:
        parts.append("No verdict of ADD(-S) changed.")
    return "\n\n".join(parts)


Pair = tuple[TargetKey, ScoredTarget, ScoredTarget]


def differences_table(pairs: Sequence[Pair], metric: str) -> Table:
    """A row an object and one for all: recalls, difference, targets right in one run only, p."""
    names = list(dict.fromkeys(each.name for _, each, _ in sorted(pairs, key=lambda p: p[0][2])))
    groups = [(name, [pair for pair in pairs if pair[1].name == name]) for name in names]
    if len(groups) > 1:
        groups.append(("all targets", list(pairs)))
    rows = []
    for name, group in groups:
        first = np.array([each.correct(metric) for _, each, _ in group])
        second = np.array([each.correct(metric) for _, _, each in group])
        blocks = blocks_of([target[:2] for target, _, _ in group])
        low, high = difference_interval(first, second, blocks, RESAMPLINGS, SEED)
        lost, gained = int((first & ~second).sum()), int((second & ~first).sum())
        rows.append(
            [
                name,
                str(len(group)),
                f"{first.mean():.3f}",
                f"{second.mean():.3f}",
                f"{second.mean() - first.mean():+.3f}",
                f"{low:+.3f} to {high:+.3f}",
                str(lost),
                str(gained),
                f"{mcnemar_exact(lost, gained):.3g}",
            ]
        )
    return Table(["object", "targets", "A", "B", "B - A", "95 %", "only A", "only B", "p"], rows)


def changes_table(pairs: Sequence[Pair]) -> Table:
    """Targets that only one run has right by ADD(-S): first the lost ones, then the gained."""

    def row(target: TargetKey, before: ScoredTarget, after: ScoredTarget) -> list[str]:
        return [
            "lost" if before.correct("add") else "gained",
            f"{target[0]}/{target[1]}",
            after.name,
            f"{after.score.visible_fraction:.2f}",
            f"{1e3 * before.score.add_error:.1f}",
            f"{1e3 * after.score.add_error:.1f}",
            f"{np.rad2deg(before.score.rotation_error):.1f}",
            f"{np.rad2deg(after.score.rotation_error):.1f}",
        ]

    changed = [pair for pair in pairs if pair[1].correct("add") != pair[2].correct("add")]
    ordered = sorted(changed, key=lambda pair: (pair[2].correct("add"), pair[0][2], pair[0]))
    header = [
        "",
        "scene/image",
        "object",
        "visible",
        "A: mm",
        "B: mm",
        "A: deg",
        "B: deg",
    ]
    return Table(header, [row(*pair) for pair in ordered])


def verdict_difference(
    first: Mapping[TargetKey, float], second: Mapping[TargetKey, float]
) -> Difference | None:
    """As `mean_difference` of verdicts (0 and 1), of which no interval has zero width.

    Where all resamples are alike, as with few targets, it is as wide as Wilson's of so many.
    """
    found = mean_difference(first, second)
    if found is None or found[1][0] < found[1][1]:
        return found
    _, beyond = wilson(0.0, len(first.keys() & second.keys()))
    return found[0], (max(found[0] - beyond, -1.0), min(found[0] + beyond, 1.0))


def mean_difference(
    first: Mapping[TargetKey, float], second: Mapping[TargetKey, float]
) -> Difference | None:
    """Second's mean minus first's over the targets of both, with its 95 % interval.

    None if they have no target in common. The interval is that of `difference_interval`.
    """
    return _difference(first, second, np.mean, difference_interval)


def median_difference(
    first: Mapping[TargetKey, float], second: Mapping[TargetKey, float]
) -> Difference | None:
    """Second's median minus first's over the targets of both, with its 95 % interval.

    None if they have no target in common. The interval is that of `median_difference_interval`.
    """
    return _difference(first, second, np.median, median_difference_interval)


def _difference(
    first: Mapping[TargetKey, float],
    second: Mapping[TargetKey, float],
    statistic: Callable[[np.ndarray], Any],
    interval_of: Callable[..., tuple[float, float]],
) -> Difference | None:
    shared = sorted(first.keys() & second.keys())
    if not shared:
        return None
    before, after = (np.array([each[key] for key in shared]) for each in (first, second))
    blocks = blocks_of([key[:2] for key in shared])
    ends = interval_of(before, after, blocks, RESAMPLINGS, SEED)
    return float(statistic(after) - statistic(before)), ends


def mean_and_spread(
    repeats: Sequence[Mapping[str, float | None]],
) -> tuple[dict[str, str], dict[str, str]]:
    """Means of shares over two or more repeats, and their standard deviations, as text by name.

    Empty for a share that one of the repeats does not know.
    """
    table = pd.DataFrame(repeats, dtype=float)
    means, spreads = table.mean(skipna=False), table.std(skipna=False)
    unknown = means.isna()
    return (
        {name: "" if unknown[name] else f"{mean:.3f}" for name, mean in means.items()},
        {name: "" if unknown[name] else f"{spread:.4f}" for name, spread in spreads.items()},
    )


def mcnemar_exact(lost: int, gained: int) -> float:
    """Two-sided p of McNemar's test in its exact binomial form (McNemar 1947).

    `lost` and `gained` are the numbers of targets that only the first or only the second run has
    right.
    """
    from scipy.stats import binomtest  # takes half a second to import

    changed = lost + gained
    return 1.0 if changed == 0 else float(binomtest(lost, changed, 0.5).pvalue)


def read_targets(path: Path) -> dict[TargetKey, ScoredTarget]:
    """The targets of a `scores.csv` in the order of the file, each with its object's name.

    Several instances of an object in a frame are told apart by their order, which is that of the
    data set. Raises what `read_scores` raises.
    """
    scores, names = read_scores(path)
    keys = numbered_targets((each.scene_id, each.frame_id, each.object_id) for each in scores)
    return {
        key: ScoredTarget(names[score.object_id], score)
        for key, score in zip(keys, scores, strict=True)
    }
