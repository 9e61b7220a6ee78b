"""A line for every run and sweep in a folder of outputs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hlp.errors import DataError, InputError, MissingFileError
from hlp.files import MANIFEST, SCORES, SUMMARY, SWEEP, read_json
from hlp.reporting.comparison import ScoredTarget, read_targets
from hlp.reporting.results import read_results
from hlp.reporting.sweep_arms import sweep_of
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import LAYOUTS, Table, check_layout, format_share, lay_out
from hlp.results.summary_file import read_summary

_HEADER = ["folder", "state", "targets", "ADD(-S)", "95 %", "5cm5deg", "ms"]
_SWEEP_STATES = {"FINISHED": "arms", "STOPPED": "stopped", "RUNNING": "begun"}
_HYDRA = ".hydra"  # Hydra writes it before anything else
_UNKNOWN = [""] * (len(_HEADER) - 2)


def describe_outputs(folder: Path, layout: str) -> str:
    """The table of `run_list`, with the folder's name; names are cut to fit a terminal.

    `layout` is `text` or `markdown`. Raises MissingFileError where there is no run.
    """
    check_layout(layout)
    table = run_list(folder)
    if not table.rows:
        raise MissingFileError(f"no run in or below {folder}: `hlp run` makes one")
    shown = table.fitted(0, ends=True) if layout == "text" else table
    note = "The figures of a sweep are those of its best arm. " if any(folder.rglob(SWEEP)) else ""
    return f"{LAYOUTS[layout](shown)}\n\n{note}{len(table.rows)} runs below {folder}"


def run_list(folder: Path) -> Table:
    """A row a run or sweep, oldest first; broken ones are listed as such."""
    found = {path.parent for name in (SUMMARY, MANIFEST, SWEEP) for path in folder.rglob(name)}
    found |= {path.parent for path in folder.rglob(_HYDRA)}
    ordered = sorted(found, key=lambda each: (_age(each), each))
    return Table(_HEADER, [_row(each, folder) for each in ordered])


def _age(folder: Path) -> float:
    marks = [folder / name for name in (SUMMARY, SWEEP, MANIFEST, _HYDRA)]
    return min(path.stat().st_mtime for path in marks if path.exists())


def _row(run: Path, root: Path) -> list[str]:
    name = str(run.relative_to(root))
    try:
        if (run / SWEEP).is_file():
            return [name, *_sweep_cells(run)]
        finished = (run / MANIFEST).is_file()
        if not (run / SUMMARY).is_file():
            return [name, "study" if finished else "unfinished", *_UNKNOWN]
        figures = _figures(read_summary(run / SUMMARY))
        return [name, "finished" if finished else "unfinished", *figures]
    except (DataError, KeyError, TypeError, ValueError):
        return [name, "broken", *_UNKNOWN]


def _sweep_cells(folder: Path) -> list[str]:
    """How many of the arms that have begun are finished, and the best arm's figures."""
    state = _SWEEP_STATES[read_json(folder / SWEEP)["status"]]
    arms = [path for path in folder.iterdir() if path.is_dir() and path.name.isdigit()]
    finished = sum((arm / MANIFEST).is_file() for arm in arms)
    best = sweep_of(read_results(folder)).best
    figures = _UNKNOWN if best is None or best.result is None else _figures(best.result.summary)
    return [f"{finished}/{len(arms)} {state}", *figures]


def _figures(summary: Mapping[str, Any]) -> list[str]:
    metrics, time = summary["metrics"], summary["timing_ms"]["total"]["median"]
    low, high = metrics["add"]["ci95"]
    return [
        str(summary["targets"]),
        format_share(metrics["add"]["recall"]),
        f"{low:.2f}-{high:.2f}",  # two decimals leave room for the folder
        format_share(metrics["5cm5deg"]["recall"]),
        f"{time:.0f}",
    ]


# They change no pose, or are shown elsewhere.


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
