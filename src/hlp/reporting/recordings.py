"""One table of the data sets of `experiment=recordings`, all run by one configuration."""

from pathlib import Path

from hlp.files import write_csv, write_text
from hlp.reporting.results import Result, ResultSet, read_results, result_folders
from hlp.reporting.tables.table import Table, format_interval, format_share, lay_out, prose

NAME = "recordings"
"""The experiment, and the files that its table is written to."""
_DATA = "data"
_WIDE = ("frames", "VSD", "MSSD", "MSPD")  # columns for which a terminal has no room
_BOP = ("ar", "vsd", "mssd", "mspd")


def describe_recordings(root: Path, layout: str) -> str:
    """The tables of all sweeps over recordings in or below a folder, which are written anew.

    Empty if there is none. `layout` is `text` or `markdown`.
    """
    parts = []
    for folder in result_folders(root):
        files = write_recordings(folder)
        if files:
            found = read_results(folder)
            written = ", ".join(str(path) for path in files)
            table = recordings_table(found)
            shown = table.without(*_WIDE).fitted(0) if layout == "text" else table
            said = [prose(words, layout) for words in (_note(found), f"Written: {written}")]
            parts += [said[0], lay_out(shown, layout), said[1]]
    return "\n\n".join(parts)


def write_recordings(folder: Path) -> list[Path]:
    """Write recordings.md and .csv of a sweep over recordings; those files, none otherwise."""
    found = read_results(folder)
    if not found.results or any(each.experiment != NAME for each in found.results):
        return []
    table = recordings_table(found)
    markdown, rows = folder / f"{NAME}.md", folder / f"{NAME}.csv"
    write_text(markdown, f"{_note(found)}\n\n{table.markdown()}\n")
    write_csv(rows, table.header, table.rows)
    return [markdown, rows]


def recordings_table(found: ResultSet) -> Table:
    """A row a data set: its size, recalls, BOP's average recalls, time of one object (ms)."""
    header = [
        "data",
        "frames",
        "targets",
        "ADD(-S)",
        "95 %",
        "5cm5deg",
        "AR",
        *map(str.upper, _BOP[1:]),
        "ECE",
    ]
    return Table([*header, "ms"], [_row(each) for each in found.results])


def _row(result: Result) -> list[str]:
    metrics, bop = result.summary["metrics"], result.summary.get("bop", {})
    return [
        result.chosen.get(_DATA, str(result.config[_DATA]["name"])),
        str(result.frames),
        str(result.targets),
        format_share(result.add["recall"]),
        format_interval(result.add["ci95"]),
        format_share(metrics["5cm5deg"]["recall"]),
        *(format_share(bop.get(key)) for key in _BOP),
        format_share(result.summary.get("calibration", {}).get("ece")),
        f"{result.total_ms['median']:.0f}",
    ]


def _note(found: ResultSet) -> str:
    missing = f" Left out or unfinished: {len(found.unfinished)}." if found.unfinished else ""
    return (
        f"Made by `{found.command}`.{missing} ADD(-S): ADD-S for objects with a symmetry, ADD for"
        " the others. AR: mean of BOP's average recalls VSD, MSSD and MSPD. ECE: expected"
        " calibration error of the score. ms: median for one object in one frame."
    )
