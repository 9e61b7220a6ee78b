"""The table that a sweep of `hlp bench` ends with: a row an arm, from the bench.json of each."""

from pathlib import Path

from hlp.errors import DataError
from hlp.files import SWEEP, write_csv, write_text
from hlp.reporting.results import chosen_values
from hlp.reporting.sweep_arms import short_key
from hlp.reporting.tables.bench_table import CONFIGURED, TOTAL, Result, format_ms, read_bench
from hlp.reporting.tables.table import Table, format_share, lay_out, prose
from hlp.schemas.reading import read_as
from hlp.schemas.runs import Sweep

NAME = "bench"
"""The files that the table is written to, and that an arm has measured."""
_HEADER = ["ms first", "ms further", "CPU first", "CPU further", "MiB", "ADD(-S)"]
_NOTE = (
    "Median time to find the first object of a frame, and each further one; CPU: ms of all threads."
    " MiB: peak memory of the process, which arms of one process share with those before them."
)


def describe_benches(folder: Path, layout: str) -> str:
    """The arms of a sweep of benches for people (`text` or `markdown`); empty for other sweeps.

    Raises DataError for a broken file.
    """
    table, names = _table(folder)
    if not table.rows:
        return ""
    shown = table.fitted(*range(names)) if layout == "text" else table
    return f"{lay_out(shown, layout)}\n\n{prose(_NOTE, layout)}"


def write_benches(folder: Path) -> list[Path]:
    """Write bench.md and bench.csv of a sweep of benches; those files, none for other sweeps.

    Raises DataError for a broken file.
    """
    table, _ = _table(folder)
    if not table.rows:
        return []
    markdown, rows = folder / f"{NAME}.md", folder / f"{NAME}.csv"
    command = " ".join(["hlp bench -m", *read_as(folder / SWEEP, Sweep).overrides])
    parts = [table.markdown(), _NOTE, f"Made by `{command.replace(' task=bench', '')}`."]
    write_text(markdown, "\n\n".join(parts) + "\n")
    write_csv(rows, table.header, table.rows)
    return [markdown, rows]


def _table(folder: Path) -> tuple[Table, int]:
    """The table, without rows if no arm is a bench, and how many columns name the arm."""
    arms = [path for path in folder.iterdir() if path.is_dir() and path.name.isdigit()]
    if not any((arm / f"{NAME}.json").is_file() for arm in arms):
        return Table(_HEADER, []), 0
    keys = read_as(folder / SWEEP, Sweep).swept
    rows = []
    for arm in sorted(arms, key=lambda path: int(path.name)):
        values = chosen_values(arm)
        named = [values.get(key, "") for key in keys] or [arm.name]
        rows.append([*named, *_measured(arm / f"{NAME}.json")])
    names = [short_key(key) for key in keys] or ["run"]
    return Table([*names, *_HEADER], rows), len(names)


def _measured(path: Path) -> list[str]:
    if not path.is_file():
        return ["no result", *[""] * (len(_HEADER) - 1)]
    result: Result = read_bench(path)
    try:
        configured = result["paths"][CONFIGURED]
        totals = [configured[unit].get(TOTAL) for unit in ("first", "further")]
        times = [
            "" if total is None else format_ms(total[kind])
            for kind in ("median_ms", "cpu_ms")
            for total in totals
        ]
        peak = f"{result['memory']['peak_mib']:.0f}"
        return [*times, peak, format_share(configured["add_recall"])]
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise DataError(f"{path} is no bench ({error!r})") from error
