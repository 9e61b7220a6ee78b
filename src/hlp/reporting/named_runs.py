"""Runs that somebody names: two are compared; of more, repeats, mean and spread are told."""

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

from hlp.errors import InputError
from hlp.reporting.comparison import compare_runs, read_targets
from hlp.reporting.mlflow_runs import scores_file
from hlp.reporting.tables.repeats import mean_and_spread
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, check_layout, format_share, lay_out
from hlp.results.average_recalls import average_recalls


def describe_named(runs: str, uri: str, layout: str) -> str:
    """What `compare_runs` or `describe_repeats` says of `[A,B,…]`.

    Each is an output folder or the id of a run in MLflow at `uri`. Raises InputError for fewer than
    two, otherwise what these two raise.
    """
    names = [each.strip() for each in runs.removeprefix("[").removesuffix("]").split(",")]
    if len(names) < 2 or not all(names):
        raise InputError(f"runs={runs}: name two or more, as runs=[A,B]")
    files = [scores_file(each, uri) for each in names]
    if len(names) == 2:
        return compare_runs(files[0], files[1], (names[0], names[1]), layout)
    return describe_repeats(files, names, layout)


def describe_repeats(files: Sequence[Path], names: Sequence[str], layout: str) -> str:
    """Recalls of repeats, such as one configuration with several seeds: each, mean and spread.

    `files` are their `scores.csv`; AR is BOP's average recall, empty where it was not computed.
    Raises FileNotFoundError without a file, ValueError for a broken one and for a `layout` that is
    not `text` or `markdown`.
    """
    check_layout(layout)
    recalls, targets = [], []
    for path in files:
        scored = read_targets(path)
        targets.append(scored.keys())
        shares = [fmean(each.correct(key) for each in scored.values()) for key in METRIC_LABELS]
        recalls.append([*shares, average_recalls([each.score for each in scored.values()])["ar"]])
    rows = [
        [name, str(len(asked)), *map(format_share, found)]
        for name, asked, found in zip(names, targets, recalls, strict=True)
    ]
    means, deviations = mean_and_spread(recalls)
    rows += [["mean", "", *means], ["standard deviation", "", *deviations]]
    whole = Table(["run", "targets", *METRIC_LABELS.values(), "AR"], rows)
    table = lay_out(whole.fitted(0, ends=True) if layout == "text" else whole, layout)
    same = all(each == targets[0] for each in targets)
    return table if same else f"{table}\n\nThe runs were not asked for the same targets."
