"""Two runs compared target by target, with interval and test of the difference."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import numpy as np

from hlp.arrays import grouped
from hlp.errors import DataError
from hlp.records import TargetScore
from hlp.reporting.summary_tables import METRIC_LABELS
from hlp.reporting.table import Table, format_share, lay_out, prose
from hlp.results.poses_file import read_scores
from hlp.results.recalls import METRICS, TargetKey, blocks_of, difference_interval, numbered_targets

RESAMPLINGS = 10_000
SEED = 0
CHANGES_SHOWN = 40
EXPLAINED = (
    "Recall of run B minus recall of run A over the targets that both have, with the 95 % interval"
    " of the paired bootstrap over blocks of neighbouring frames. p is McNemar's exact two-sided"
    " test on the targets that only one run has right. It assumes that targets are independent, so"
    " the interval is the safer guide."
)
WELL_VISIBLE = 0.6
"""Visible fraction from which a target counts as well visible."""
Difference = tuple[float, tuple[float, float]]
"""A difference of two means, and its 95 % interval."""


@dataclass(frozen=True)
class ScoredTarget:
    """One target's score and the name of its object."""

    name: str
    score: TargetScore

    def correct(self, metric: str) -> bool:
        """Verdict of a metric, named as in `summary.json`."""
        return METRICS[metric](self.score)


def read_targets(path: Path) -> dict[TargetKey, ScoredTarget]:
    """The targets of a `scores.csv` in the order of the file, each with its object's name.

    Several instances of an object in a frame are told apart by their order, which is that of the
    data set. Raises what `read_scores` raises.
    """
    scores, names = read_scores(path)
    keys = numbered_targets((score.scene_id, score.frame_id, score.object_id) for score in scores)
    return {
        key: ScoredTarget(names[score.object_id], score)
        for key, score in zip(keys, scores, strict=True)
    }


def recall_of(targets: Sequence[ScoredTarget], metric: str) -> float:
    """Share of one or more targets that are right by a metric of `summary.json`."""
    return float(np.mean([target.correct(metric) for target in targets]))


def difference_cells(found: Difference) -> list[str]:
    """A difference and its interval as they stand in tables: `+0.100`, `-0.012 to +0.210`."""
    value, low, high = with_ends(found)
    return [value, f"{low} to {high}"]


def with_ends(found: Difference | None) -> list[str]:
    """A difference and the ends of its interval, as in figures.csv; empty without one."""
    return [f"{value:+.3f}" for value in (found[0], *found[1])] if found else [""] * 3


def compare_runs(first: Path, second: Path, names: tuple[str, str], layout: str) -> str:
    """Tables of the differences between two runs, given their `scores.csv`.

    Raises MissingFileError without a file; DataError for a broken one, and for runs that have no
    target in common.
    """
    scores = (read_targets(first), read_targets(second))
    shared = sorted(scores[0].keys() & scores[1].keys())
    if not shared:
        raise DataError(f"{names[0]} and {names[1]} have no target in common")
    alone = [len(targets) - len(shared) for targets in scores]
    only = f"; left out: {alone[0]} targets that only A has, {alone[1]} that only B has"
    counted = f"{len(shared)} targets in common{only if any(alone) else ''}"
    parts = [f"A = {names[0]}\nB = {names[1]}", prose(EXPLAINED, layout), prose(counted, layout)]
    pairs = [(target, scores[0][target], scores[1][target]) for target in shared]
    for metric, label in METRIC_LABELS.items():
        table = differences_table(pairs, metric)
        shown = table.without("targets") if layout == "text" else table
        parts.append(f"{label}\n\n{lay_out(shown, layout)}")
    changes = changes_table(pairs)
    if not changes.rows:
        return "\n\n".join([*parts, "No verdict of ADD(-S) changed."])
    few = lay_out(Table(changes.header, changes.rows[:CHANGES_SHOWN]), layout)
    left = len(changes.rows) - CHANGES_SHOWN
    more = f"\n… and {left} more" if left > 0 else ""
    changed = f"Changed verdicts of ADD(-S): {len(changes.rows)}"
    return "\n\n".join([*parts, changed, f"{few}{more}"])


Pair = tuple[TargetKey, ScoredTarget, ScoredTarget]


def differences_table(pairs: Sequence[Pair], metric: str) -> Table:
    """A row an object and one for all: recalls, difference, targets right in one run only, p."""
    groups = grouped(sorted(pairs, key=lambda pair: pair[0][2]), lambda pair: pair[1].name)
    if len(groups) > 1:
        groups["all targets"] = [*pairs]
    rows = []
    for name, group in groups.items():
        first = {target: float(before.correct(metric)) for target, before, _ in group}
        second = {target: float(after.correct(metric)) for target, _, after in group}
        found = paired_difference(first, second)
        assert found is not None
        changes = [second[target] - first[target] for target in first]
        lost, gained = changes.count(-1.0), changes.count(1.0)
        recalls = [format_share(fmean(verdicts.values())) for verdicts in (first, second)]
        changed = [str(lost), str(gained), f"{mcnemar_exact(lost, gained):.3g}"]
        rows.append([name, str(len(group)), *recalls, *difference_cells(found), *changed])
    return Table(["object", "targets", "A", "B", "B - A", "95 %", "only A", "only B", "p"], rows)


def changes_table(pairs: Sequence[Pair]) -> Table:
    """Targets that only one run has right by ADD(-S): first the lost ones, then the gained."""
    changed = [pair for pair in pairs if pair[1].correct("add") != pair[2].correct("add")]
    rows = []
    for target, a, b in sorted(changed, key=lambda p: (p[2].correct("add"), p[0][2], p[0])):
        errors = [f"{1e3 * run.score.add_error:.1f}" for run in (a, b)]
        errors += [f"{np.rad2deg(run.score.rotation_error):.1f}" for run in (a, b)]
        named = ["lost" if a.correct("add") else "gained", f"{target[0]}/{target[1]}", b.name]
        rows.append([*named, f"{b.score.visible_fraction:.2f}", *errors])
    errors = ["A: mm", "B: mm", "A: deg", "B: deg"]
    return Table(["", "scene/image", "object", "visible", *errors], rows)


def paired_difference(
    first: Mapping[TargetKey, float], second: Mapping[TargetKey, float]
) -> Difference | None:
    """Second's mean minus first's over the targets of both; None if they have none in common.

    The interval is that of `difference_interval`.
    """
    shared = sorted(first.keys() & second.keys())
    if not shared:
        return None
    before, after = (np.array([values[key] for key in shared]) for values in (first, second))
    blocks = blocks_of([key[:2] for key in shared])
    ends = difference_interval(before, after, blocks, RESAMPLINGS, SEED)
    return float(after.mean() - before.mean()), ends


def surely(found: Difference) -> bool:
    """Whether the interval of a difference lies on one side of zero; otherwise it is a tie."""
    low, high = found[1]
    return low > 0.0 or high < 0.0


def mcnemar_exact(lost: int, gained: int) -> float:
    """Two-sided p of McNemar's test in its exact binomial form (McNemar 1947).

    `lost` and `gained` are the numbers of targets that only the first or only the second run has
    right.
    """
    from scipy.stats import binomtest  # takes half a second to import

    changed = lost + gained
    return 1.0 if changed == 0 else float(binomtest(lost, changed, 0.5).pvalue)
