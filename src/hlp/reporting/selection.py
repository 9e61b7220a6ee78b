"""Recall of some objects only: of all their targets, and by how much of a target is visible."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hlp.reporting.comparison import Scored, read_scored
from hlp.reporting.tables import FORMATS, METRICS, Table

_HALF_HIDDEN = 0.6  # from which visible fraction on a target counts as well seen
_SCORES = "scores.csv"


def report_selection(folder: Path, objects: str, layout: str) -> str:
    """A table for each run in or below a folder of the objects `[a,b,…]`.

    Raises FileNotFoundError where there is no run, ValueError for an object that a run has not, a
    broken `scores.csv`, and a `layout` that is not `text` or `markdown`.
    """
    if layout not in FORMATS:
        raise ValueError(f"format={layout}: choose one of {', '.join(FORMATS)}")
    names = [each.strip() for each in objects.removeprefix("[").removesuffix("]").split(",")]
    found = sorted(folder.rglob(_SCORES))
    if not found:
        raise FileNotFoundError(f"no finished run in {folder}: none of its folders has {_SCORES}")
    parts = [f"Recall of {', '.join(names)}"]
    for path in found:
        table = selection_table(list(read_scored(path).values()), names)
        parts += [str(path.parent), FORMATS[layout](table)]
    return "\n\n".join(parts)


def selection_table(scores: Sequence[Scored], names: Sequence[str]) -> Table:
    """Recall over the targets of the named objects and the mean of the objects' recalls.

    Raises ValueError naming an object that has no target.
    """
    missing = sorted(set(names) - {each.name for each in scores})
    if missing:
        known = ", ".join(dict.fromkeys(each.name for each in scores))
        raise ValueError(f"objects: no target is a {missing[0]}; there are {known}")
    chosen = [each for each in scores if each.name in names]
    classes = {
        "all": chosen,
        f"{_HALF_HIDDEN:g} and more": [e for e in chosen if e.visible_fraction >= _HALF_HIDDEN],
        f"less than {_HALF_HIDDEN:g}": [e for e in chosen if e.visible_fraction < _HALF_HIDDEN],
    }
    rows = []
    for title, own in classes.items():
        if own:
            recalls = [f"{np.mean([e.correct[key] for e in own]):.3f}" for key in METRICS]
            means = [f"{_mean_of_objects(own, key):.3f}" for key in METRICS]
            rows.append([title, str(len(own)), *recalls, *means])
    shown = METRICS.values()
    return Table(["visible", "targets", *shown, *(f"mean {each}" for each in shown)], rows)


def _mean_of_objects(scores: Sequence[Scored], metric: str) -> float:
    by_object: dict[str, list[bool]] = {}
    for each in scores:
        by_object.setdefault(each.name, []).append(each.correct[metric])
    return float(np.mean([np.mean(own) for own in by_object.values()]))
