"""`hlp report` and `hlp runs`: finished runs as tables for a terminal or Markdown, and as pages."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from hlp.errors import DataError, InputError, MissingFileError
from hlp.files import MANIFEST, SCORES, SUMMARY, SWEEP
from hlp.folders import found_below, own_files
from hlp.reporting.comparison import (
    WELL_VISIBLE,
    ScoredTarget,
    compare_runs,
    read_targets,
    recall_of,
)
from hlp.reporting.mlflow import database_path, import_client, is_local
from hlp.reporting.page import study_folders, write_run_page, write_study_page, write_sweep_page
from hlp.reporting.results import left_out_if_broken, result_folders
from hlp.reporting.summary_tables import (
    METRIC_LABELS,
    format_summary,
    run_cells,
    votes_table,
    waterfall_tables,
)
from hlp.reporting.sweep_report import describe_sweep, write_sweep
from hlp.reporting.sweeps import read_sweeps
from hlp.reporting.table import Table, format_share, lay_out, prose
from hlp.results.recalls import average_recalls, read_summary
from hlp.schemas import record
from hlp.settings import read_as


def report_runs(folder: Path, layout: str, details: bool = False) -> str:
    """A line for each run in or below a folder, oldest first, and a table for each sweep.

    `layout` is `text` or `markdown`. The tables of a run follow if it is the only one, or with
    `details`. Of studies (oracle, basin, bench, search) there are the tables or their names. Draws
    figures into each sweep's folder. What is broken is left out with a warning. Raises DataError if
    there is nothing else, and MissingFileError where no finished run is found.
    """
    sweeps = [path.parent for path in found_below(folder, SWEEP)]
    paths = sorted(found_below(folder, SUMMARY), key=lambda path: path.stat().st_mtime)
    studies = study_folders(folder)
    if not paths and not sweeps and not studies:
        raise MissingFileError(f"no finished run ({SUMMARY}) in or below {folder}")
    summaries, alone = {}, len(paths) + len(sweeps) == 1
    for path in paths:
        with left_out_if_broken(alone):
            summaries[path.parent] = read_summary(path)
    heading = "## " if layout == "markdown" else ""
    parts = []
    for run, summary in summaries.items():
        if details or len(summaries) == 1:
            parts.append(f"{heading}{run}\n\n{format_summary(summary, layout)}")
            tables = (*waterfall_tables(summary), votes_table(summary))
            parts += [lay_out(table, layout) for table in tables]
    for sweep in sweeps:
        with left_out_if_broken(alone):
            parts += _sweep_parts(sweep, layout, heading)
    alone_there = (study for study in studies if study.parent not in sweeps)
    parts += [_study_part(study, layout, heading) for study in alone_there]
    if len(summaries) > 1:
        parts.append(f"{heading}All runs below {folder}\n\n{lay_out(run_list(folder), layout)}")
        if not details:
            parts.append("details=true prints the tables of every run.")
    return "\n\n".join(parts)


def _study_part(study: Path, layout: str, heading: str) -> str:
    """A study's tables as Markdown; for a terminal, which they are too wide for, their names."""
    tables = sorted(study.glob("*.md"))
    if layout == "markdown":
        return "\n\n".join([f"{heading}{study}", *(table.read_text("utf-8") for table in tables)])
    return prose(f"Study: {study} ({', '.join(table.name for table in tables)})", layout)


def _sweep_parts(folder: Path, layout: str, heading: str) -> list[str]:
    """The tables of a sweep of runs or studies, and the files written."""
    sweeps = read_sweeps(folder)
    described = "\n\n".join(describe_sweep(sweep, layout) for sweep in sweeps)
    written = [path for sweep in sweeps for path in write_sweep(folder, sweep)]
    if not written:
        return []
    names = ", ".join(path.name for path in written)
    return [f"{heading}{folder}\n\n{described}", prose(f"Written: {folder} ({names})", layout)]


def write_pages(folder: Path) -> list[Path]:
    """Write the page of the run, sweep or study in a folder; of all in it if there are several.

    The runs of a sweep have pages of their own too. Raises what the pages raise.
    """
    written, folders = list[Path](), result_folders(folder)
    for found in folders:
        with left_out_if_broken(len(folders) == 1):
            if (found / SWEEP).is_file():
                runs = sorted(path.parent for path in found.glob(f"*/{SCORES}"))
                written += [write_run_page(run) for run in runs if (run / MANIFEST).is_file()]
                if any(sweep.finished for sweep in read_sweeps(found)):
                    written.append(write_sweep_page(found))
            elif (found / SCORES).is_file():
                written.append(write_run_page(found))
    return written + [write_study_page(found) for found in study_folders(folder)]


def scores_file(run: str, uri: str) -> Path:
    """`scores.csv` of a run that is named by its output folder, or by its id in MLflow.

    Raises MissingFileError where neither is found, or the run has no scores.
    """
    if Path(run).is_dir():
        own_files(Path(run))
        path = Path(run) / SCORES
        if not path.is_file():
            raise MissingFileError(f"no {SCORES} in {run}: it holds no finished run")
        return path
    if is_local(uri) and not database_path(uri).is_file():
        raise MissingFileError(f"no folder {run}, and no MLflow database {uri} to look for it in")
    client = import_client()(uri)
    from mlflow.exceptions import MlflowException

    try:
        return Path(client.download_artifacts(run, SCORES))
    except (MlflowException, OSError) as error:
        raise MissingFileError(f"no folder {run}, and no scores of such a run in {uri}") from error


def describe_named(runs: str, uri: str, layout: str) -> str:
    """What `compare_runs` or `describe_repeats` says of `[A,B,…]`.

    Each is an output folder or the id of a run in MLflow at `uri`. Raises InputError for fewer than
    two, otherwise what these two raise.
    """
    names = _listed(runs)
    if len(names) < 2 or not all(names):
        raise InputError(f"runs={runs}: name two or more, as runs=[A,B]")
    files = [scores_file(name, uri) for name in names]
    if len(names) == 2:
        return compare_runs(files[0], files[1], (names[0], names[1]), layout)
    return describe_repeats(files, names, layout)


def describe_repeats(files: Sequence[Path], names: Sequence[str], layout: str) -> str:
    """Recalls of repeats, such as one configuration with several seeds: each, mean and spread.

    `files` are their `scores.csv`; AR is BOP's average recall, empty where it was not computed.
    Raises MissingFileError without a file, DataError for a broken one.
    """
    scored = [read_targets(path) for path in files]
    found = []
    for targets in (list(own.values()) for own in scored):
        average = average_recalls([target.score for target in targets])["ar"]
        found.append([*(recall_of(targets, key) for key in METRIC_LABELS), average])
    recalls = pd.DataFrame(found, dtype=float)
    rows = [
        [name, str(len(own)), *map(format_share, shares)]
        for name, own, shares in zip(names, scored, recalls.to_numpy(), strict=True)
    ]
    rows.append(["mean", "", *map(format_share, recalls.mean(skipna=False))])
    spread = recalls.std(skipna=False)
    rows.append(["standard deviation", "", *(format_share(share, 4) for share in spread)])
    table = lay_out(Table(["run", "targets", *METRIC_LABELS.values(), "AR"], rows), layout)
    same = all(own.keys() == scored[0].keys() for own in scored)
    return table if same else f"{table}\n\nThe runs were not asked for the same targets."


_HEADER = ["folder", "state", "targets", "ADD(-S)", "95 %", "5cm5deg", "ms"]
_SWEEP_STATES = {"FINISHED": "runs", "STOPPED": "stopped", "RUNNING": "begun"}
_SWEEP_STATE = record(status=Literal["FINISHED", "STOPPED", "RUNNING"])
_HYDRA = ".hydra"  # Hydra writes it before anything else
_UNKNOWN = [""] * (len(_HEADER) - 2)


def describe_outputs(folder: Path, layout: str) -> str:
    """The table of `run_list`, with the folder's name. Raises MissingFileError without a run."""
    table = run_list(folder)
    if not table.rows:
        raise MissingFileError(f"no run in or below {folder}: `hlp run` makes one")
    swept = found_below(folder, SWEEP)
    note = "The figures of a sweep are those of its best run. " if swept else ""
    return f"{lay_out(table, layout)}\n\n{note}{len(table.rows)} runs below {folder}"


def run_list(folder: Path) -> Table:
    """A row a run or sweep, oldest first; broken ones are listed as such."""
    begun: dict[Path, float] = {}
    for name in (SUMMARY, SWEEP, MANIFEST, _HYDRA):
        for path in found_below(folder, name):
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
        return ["finished" if finished else "unfinished", *_figures(read_summary(run / SUMMARY))]
    except DataError:
        return ["broken", *_UNKNOWN]


def _sweep_cells(folder: Path) -> list[str]:
    """How many of the runs that have begun are finished, and the best run's figures."""
    state = _SWEEP_STATES[read_as(folder / SWEEP, _SWEEP_STATE).status]
    runs = [path for path in folder.iterdir() if path.is_dir() and path.name.isdecimal()]
    finished = sum((run / MANIFEST).is_file() for run in runs)
    best = [sweep.best for sweep in read_sweeps(folder)]
    results = [run.result for run in best if run is not None and run.result is not None]
    figures = _figures(results[0].summary) if results else _UNKNOWN
    return [f"{finished}/{len(runs)} {state}", *figures]


def _figures(summary: Mapping[str, Any]) -> list[str]:
    cells = run_cells(summary)
    return [cells[name] for name in _HEADER[2:]]


def report_selection(folder: Path, objects: str, layout: str) -> str:
    """A table for each run in or below a folder, over the targets of the objects `[a,b,…]` alone.

    Raises MissingFileError where there is no run, DataError for a broken `scores.csv`, and
    InputError for an object that a run has not.
    """
    names = _listed(objects)
    found = found_below(folder, SCORES)
    if not found:
        raise MissingFileError(f"no finished run in {folder}: none of its folders has {SCORES}")
    parts = [f"Recall of {', '.join(names)}"]
    for path in found:
        table = selection_table(list(read_targets(path).values()), names)
        parts += [str(path.parent), lay_out(table, layout)]
    return "\n\n".join(parts)


def selection_table(scores: Sequence[ScoredTarget], names: Sequence[str]) -> Table:
    """Recall over the targets of the named objects. Raises InputError for one without a target."""
    known = dict.fromkeys(target.name for target in scores)
    for name in names:
        if name not in known:
            raise InputError(f"objects: no target is a {name}; there are {', '.join(known)}")
    chosen = [target for target in scores if target.name in names]
    visible = [target for target in chosen if target.score.visible_fraction >= WELL_VISIBLE]
    hidden = [target for target in chosen if target.score.visible_fraction < WELL_VISIBLE]
    titles = "all", f"{WELL_VISIBLE:g} and more", f"less than {WELL_VISIBLE:g}"
    rows = [
        [title, str(len(group)), *(format_share(recall_of(group, key)) for key in METRIC_LABELS)]
        for title, group in zip(titles, (chosen, visible, hidden), strict=True)
        if group
    ]
    return Table(["visible", "targets", *METRIC_LABELS.values()], rows)


def _listed(words: str) -> list[str]:
    """The names in `[a,b,…]`."""
    return [name.strip() for name in words.removeprefix("[").removesuffix("]").split(",")]
