"""Recall of chosen objects: over all their targets, and by visible fraction."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hlp.errors import InputError, MissingFileError
from hlp.files import SCORES
from hlp.reporting.comparison import ScoredTarget, read_targets
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, check_layout, lay_out

_WELL_VISIBLE = 0.6  # visible fraction from which a target counts as well visible


def report_selection(folder: Path, objects: str, layout: str) -> str:
    """A table for each run in or below a folder, over the targets of the objects `[a,b,…]` alone.

    Raises MissingFileError where there is no run, ValueError for an object that a run has not, a
    broken `scores.csv`, and a `layout` that is not `text` or `markdown`.
    """
    check_layout(layout)
    names = [each.strip() for each in objects.removeprefix("[").removesuffix("]").split(",")]
    found = sorted(folder.rglob(SCORES))
    if not found:
        raise MissingFileError(f"no finished run in {folder}: none of its folders has {SCORES}")
    parts = [f"Recall of {', '.join(names)}"]
    for path in found:
        table = selection_table(list(read_targets(path).values()), names)
        parts += [str(path.parent), lay_out(table, layout)]
    return "\n\n".join(parts)


def selection_table(scores: Sequence[ScoredTarget], names: Sequence[str]) -> Table:
    """Recall over the targets of the named objects, and the mean of the objects' recalls.

    Raises ValueError naming an object that has no target.
    """
    missing = sorted(set(names) - {each.name for each in scores})
    if missing:
        known = ", ".join(dict.fromkeys(each.name for each in scores))
        raise InputError(f"objects: no target is a {missing[0]}; there are {known}")
    chosen = [each for each in scores if each.name in names]
    classes = {
        "all": chosen,
        f"{_WELL_VISIBLE:g} and more": [
            e for e in chosen if e.score.visible_fraction >= _WELL_VISIBLE
        ],
        f"less than {_WELL_VISIBLE:g}": [
            e for e in chosen if e.score.visible_fraction < _WELL_VISIBLE
        ],
    }
    rows = []
    for title, group in classes.items():
        if group:
            recalls = [f"{np.mean([e.correct(key) for e in group]):.3f}" for key in METRIC_LABELS]
            means = [f"{_mean_of_objects(group, key):.3f}" for key in METRIC_LABELS]
            rows.append([title, str(len(group)), *recalls, *means])
    shown = METRIC_LABELS.values()
    return Table(["visible", "targets", *shown, *(f"mean {each}" for each in shown)], rows)


def _mean_of_objects(scores: Sequence[ScoredTarget], metric: str) -> float:
    by_object: dict[str, list[bool]] = {}
    for each in scores:
        by_object.setdefault(each.name, []).append(each.correct(metric))
    return float(np.mean([np.mean(group) for group in by_object.values()]))
