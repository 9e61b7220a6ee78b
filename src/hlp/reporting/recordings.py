"""One table of the data sets of `experiment=recordings`, all run by one configuration."""

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, stdev

from hlp.files import write_csv, write_text
from hlp.reporting.results import Result, ResultSet, read_results, result_folders
from hlp.reporting.tables.repeats import mean_and_spread
from hlp.reporting.tables.summary_tables import BOP_RECALLS
from hlp.reporting.tables.table import Table, format_interval, format_share, lay_out, prose

NAME = "recordings"
"""The experiment, and the files that its table is written to."""
_DATA = "data"
_SEED = "seed"
_WIDE = ("frames", "VSD", "MSSD", "MSPD")  # columns for which a terminal has no room
_BOP = ("ar", *BOP_RECALLS)


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
    """A row a data set: its size, recalls, BOP's average recalls, time of one object (ms).

    Further keys that were swept have a column each. Of several seeds, their mean and their spread
    (standard deviation) follow.
    """
    further = [key for key in found.swept if key != _DATA]
    header = [_DATA, *further, "frames", "targets", "ADD(-S)", "95 %", "5cm5deg", "AR"]
    header += [*map(str.upper, BOP_RECALLS), "ECE", "ms"]
    repeats: dict[tuple[str, ...], list[Result]] = {}
    for each in found.results:
        same = tuple(_chosen(each, [key for key in further if key != _SEED]))
        repeats.setdefault(same, []).append(each)
    return Table(header, [row for each in repeats.values() for row in _rows(each, further)])


def _chosen(result: Result, further: Sequence[str]) -> list[str]:
    """Name of the data set, and the values of the further swept keys."""
    data = result.chosen.get(_DATA, str(result.config[_DATA]["name"]))
    return [data, *(result.chosen.get(key, "") for key in further)]


def _rows(repeats: Sequence[Result], further: Sequence[str]) -> list[list[str]]:
    """A row a result; of several, which differ by their seeds, also their mean and spread."""
    rows = [_row(each, further) for each in repeats]
    if _SEED in further and len(repeats) > 1:
        means, spreads = mean_and_spread([_shares(each) for each in repeats])
        times = [each.total_ms["median"] for each in repeats]
        for name, shares, time in (
            ("mean", means, fmean(times)),
            ("spread", spreads, stdev(times)),
        ):
            row = _chosen(repeats[0], further)
            row[1 + further.index(_SEED)] = name
            rows.append([*row, "", "", shares[0], "", *shares[1:], f"{time:.0f}"])
    return rows


def _row(result: Result, further: Sequence[str]) -> list[str]:
    add, *others = map(format_share, _shares(result))
    size = [str(result.frames), str(result.targets)]
    interval, time = format_interval(result.add["ci95"]), f"{result.total_ms['median']:.0f}"
    return [*_chosen(result, further), *size, add, interval, *others, time]


def _shares(result: Result) -> list[float | None]:
    """Recalls by ADD(-S) and 5cm5deg, BOP's, and the error of the scores; None if not known."""
    metrics, bop = result.summary["metrics"], result.summary.get("bop", {})
    error = result.summary.get("calibration", {}).get("ece")
    return [result.add["recall"], metrics["5cm5deg"]["recall"], *map(bop.get, _BOP), error]


def _note(found: ResultSet) -> str:
    missing = f" Left out or unfinished: {len(found.unfinished)}." if found.unfinished else ""
    spread = " spread: standard deviation between seeds." if _SEED in found.swept else ""
    return (
        f"Made by `{found.command}`.{missing} ADD(-S): ADD-S for objects with a symmetry, ADD for"
        " the others. AR: mean of BOP's average recalls VSD, MSSD and MSPD. ECE: expected"
        f" calibration error of the score. ms: median for one object in one frame.{spread}"
    )
