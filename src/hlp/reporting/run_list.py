"""A line for every run and sweep in a folder of outputs."""

from pathlib import Path

from hlp.errors import DataError, MissingFileError
from hlp.files import MANIFEST, SUMMARY, SWEEP, read_json
from hlp.reporting.tables.table import LAYOUTS, Table, check_layout, format_interval, format_share
from hlp.results.summary_file import read_summary

_HEADER = ["folder", "state", "targets", "ADD(-S)", "95 %", "ms"]
_LONGEST = 28  # characters of a folder
_SWEEP_STATES = {"FINISHED": "sweep", "STOPPED": "sweep, stopped", "RUNNING": "sweep, begun"}
_HYDRA = ".hydra"  # Hydra writes it before anything else


def describe_outputs(folder: Path, layout: str) -> str:
    """The table of `run_list`, with the folder's name.

    `layout` is `text` or `markdown`. Raises MissingFileError where there is no run.
    """
    check_layout(layout)
    table = run_list(folder)
    if not table.rows:
        raise MissingFileError(f"no run in or below {folder}: `hlp run` makes one")
    return f"{LAYOUTS[layout](table)}\n\n{len(table.rows)} runs below {folder}"


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
    shown = name if len(name) <= _LONGEST else f"…{name[-_LONGEST + 1 :]}"
    try:
        if (run / SWEEP).is_file():
            return [shown, _SWEEP_STATES.get(read_json(run / SWEEP)["status"], "broken"), *[""] * 4]
        if not (run / SUMMARY).is_file():
            return [shown, "study" if (run / MANIFEST).is_file() else "not finished", *[""] * 4]
        summary = read_summary(run / SUMMARY)
        add, time = summary["metrics"]["add"], summary["timing_ms"]["total"]["median"]
        state = "finished" if (run / MANIFEST).is_file() else "not finished"
        recall, ends = format_share(add["recall"]), format_interval(add["ci95"])
        return [shown, state, str(summary["targets"]), recall, ends, f"{time:.0f}"]
    except (DataError, KeyError, TypeError, ValueError):
        return [shown, "broken", *[""] * 4]
