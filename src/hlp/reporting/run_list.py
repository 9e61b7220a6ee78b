"""A line for every run and sweep in a folder of outputs; recalls of chosen objects."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hlp.errors import DataError, InputError, MissingFileError
from hlp.files import MANIFEST, SCORES, SUMMARY, SWEEP, read_json
from hlp.reporting.comparison import WELL_VISIBLE, ScoredTarget, read_targets, recall_of
from hlp.reporting.sweeps import read_sweeps
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import LAYOUTS, Table, check_layout, format_share, lay_out
from hlp.results.summary_file import read_summary

_HEADER = ["folder", "state", "targets", "ADD(-S)", "95 %", "5cm5deg", "ms"]
_SWEEP_STATES = {"FINISHED": "runs", "STOPPED": "stopped", "RUNNING": "begun"}
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
    note = "The figures of a sweep are those of its best run. " if any(folder.rglob(SWEEP)) else ""
    return f"{LAYOUTS[layout](shown)}\n\n{note}{len(table.rows)} runs below {folder}"


def run_list(folder: Path) -> Table:
    """A row a run or sweep, oldest first; broken ones are listed as such."""
    begun: dict[Path, float] = {}
    for name in (SUMMARY, SWEEP, MANIFEST, _HYDRA):
        for path in folder.rglob(name):
            age = path.stat().st_mtime
            begun[path.parent] = min(age, begun.get(path.parent, age))
    ordered = sorted(begun, key=lambda run: (begun[run], run))
    return Table(_HEADER, [[str(run.relative_to(folder)), *_cells(run)] for run in ordered])


def _cells(run: Path) -> list[str]:
    """The state of a run or sweep, and its figures."""
    try:
        if (run / SWEEP).is_file():
            return _sweep_cells(run)
        finished = (run / MANIFEST).is_file()
        if not (run / SUMMARY).is_file():
            return ["study" if finished else "unfinished", *_UNKNOWN]
        figures = _figures(read_summary(run / SUMMARY))
        return ["finished" if finished else "unfinished", *figures]
    except (DataError, KeyError, TypeError, ValueError):
        return ["broken", *_UNKNOWN]


def _sweep_cells(folder: Path) -> list[str]:
    """How many of the runs that have begun are finished, and the best run's figures."""
    state = _SWEEP_STATES[read_json(folder / SWEEP)["status"]]
    runs = [path for path in folder.iterdir() if path.is_dir() and path.name.isdigit()]
    finished = sum((run / MANIFEST).is_file() for run in runs)
    best = [sweep.best for sweep in read_sweeps(folder)]
    results = [run.result for run in best if run is not None and run.result is not None]
    figures = _figures(results[0].summary) if results else _UNKNOWN
    return [f"{finished}/{len(runs)} {state}", *figures]


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


def report_selection(folder: Path, objects: str, layout: str) -> str:
    """A table for each run in or below a folder, over the targets of the objects `[a,b,…]` alone.

    Raises MissingFileError where there is no run, ValueError for an object that a run has not, a
    broken `scores.csv`, and a `layout` that is not `text` or `markdown`.
    """
    check_layout(layout)
    names = [name.strip() for name in objects.removeprefix("[").removesuffix("]").split(",")]
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
    known = dict.fromkeys(target.name for target in scores)
    for name in sorted(names):
        if name not in known:
            raise InputError(f"objects: no target is a {name}; there are {', '.join(known)}")
    chosen = [target for target in scores if target.name in names]
    seen = [target for target in chosen if target.score.visible_fraction >= WELL_VISIBLE]
    hidden = [target for target in chosen if target.score.visible_fraction < WELL_VISIBLE]
    groups = {
        "all": chosen,
        f"{WELL_VISIBLE:g} and more": seen,
        f"less than {WELL_VISIBLE:g}": hidden,
    }
    rows = []
    for title, group in groups.items():
        if group:
            recalls = [format_share(recall_of(group, metric)) for metric in METRIC_LABELS]
            means = [format_share(_mean_of_objects(group, metric)) for metric in METRIC_LABELS]
            rows.append([title, str(len(group)), *recalls, *means])
    shown = METRIC_LABELS.values()
    return Table(["visible", "targets", *shown, *(f"mean {label}" for label in shown)], rows)


def _mean_of_objects(targets: Sequence[ScoredTarget], metric: str) -> float:
    by_object: dict[str, list[ScoredTarget]] = {}
    for target in targets:
        by_object.setdefault(target.name, []).append(target)
    return float(np.mean([recall_of(group, metric) for group in by_object.values()]))
