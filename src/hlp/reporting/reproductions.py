"""The paper's figures and tables from finished runs, with its numbers beside ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.files import write_csv, write_text
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.trade_off import draw_recalls
from hlp.reporting.figures.trends import TRENDS, draw_trend, trend_note, trend_table
from hlp.reporting.results import Result, ResultSet, read_results, result_folders
from hlp.reporting.tables.paper_tables import (
    METRICS_NOTE,
    OBJECTS_NOTE,
    metric_columns,
    metric_recalls_table,
    object_columns,
    object_recalls_table,
    objects_of,
)
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, lay_out, prose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLES = {"table1": "Table 1: ADD(-S) recall", "table2": "Table 2: recall"}
"""Titles of the tables by the name of their experiment."""


@dataclass(frozen=True)
class Reproduction:
    """A figure or table of the paper with our results; `notes` are its caption."""

    name: str
    table: Table
    figure: "Figure"
    notes: list[str]


def describe_reproductions(root: Path, layout: str) -> str:
    """Reproduce and write every figure and table of the paper that has runs in or below a folder.

    Returns captions, tables and the files' names for people; empty if no run belongs to a figure or
    table of the paper. `layout` is `text` or `markdown`.
    """
    parts = []
    for folder in result_folders(root):
        for made in reproduce(read_results(folder)):
            files = ", ".join(str(path) for path in write_reproduction(folder, made))
            said = [prose(words, layout) for words in (*made.notes, f"Written: {files}")]
            parts += [*said[:-1], lay_out(made.table, layout), said[-1]]
    return "\n\n".join(parts)


def write_reproductions(folder: Path) -> list[Path]:
    """Reproduce the paper's figure or table that a sweep or run belongs to; the files written."""
    made = reproduce(read_results(folder))
    return [path for each in made for path in write_reproduction(folder, each)]


def describe_table(folder: Path) -> str:
    """The paper's table that a sweep or run belongs to, for a terminal; empty if to none."""
    made = [each for each in reproduce(read_results(folder)) if each.name in TABLES]
    words = [
        part
        for each in made
        for part in (
            prose(each.notes[0], "text"),
            lay_out(each.table, "text"),
            prose(each.notes[-1], "text"),
        )
    ]
    return "\n\n".join(words)


def reproduce(found: ResultSet) -> list[Reproduction]:
    """The paper's figures and tables with these results, one for each experiment among them."""
    made = []
    for name in dict.fromkeys(result.experiment for result in found.results):
        results = [each for each in found.results if each.experiment == name]
        if name in TRENDS:
            made.append(_trend(name, results, found))
        elif name in TABLES:
            made.append(_table(name, results, found))
    return made


def write_reproduction(folder: Path, made: Reproduction) -> list[Path]:
    """Write NAME.png, .svg, .md, .csv and .tex; those files."""
    png, svg = save_figure(made.figure, folder / made.name)
    markdown, table, latex = (folder / f"{made.name}.{ending}" for ending in ("md", "csv", "tex"))
    picture = f"![{made.name}]({svg.name})"
    write_text(markdown, "\n\n".join([picture, *made.notes, made.table.markdown()]) + "\n")
    write_csv(table, made.table.header, made.table.rows)
    write_text(latex, made.table.latex() + "\n")
    return [png, svg, markdown, table, latex]


def _trend(name: str, results: Sequence[Result], found: ResultSet) -> Reproduction:
    trend = TRENDS[name]
    series: dict[str, list[Result]] = {}
    for result in results:
        series.setdefault(_chosen(result, found.swept, trend.keys), []).append(result)
    figure = draw_trend(trend, series, _measured_on(results[0]))
    notes = [f"{trend.title}, {_measured_on(results[0])}.", *_made_by(found), trend_note(trend)]
    return Reproduction(name, trend_table(trend, series), figure, notes)


def _table(name: str, results: Sequence[Result], found: ResultSet) -> Reproduction:
    runs: dict[str, Result] = {}
    for result in results:
        runs[_chosen(result, found.swept, ()) or "ours"] = result
    title = f"{TABLES[name]}, {_measured_on(results[0])}"
    if name == "table1":
        table, note = object_recalls_table(runs), OBJECTS_NOTE
        figure = draw_recalls(objects_of(runs), object_columns(runs), title, note)
    else:
        table, note = metric_recalls_table(runs), METRICS_NOTE
        figure = draw_recalls([*METRIC_LABELS.values()], metric_columns(runs), title, note)
    return Reproduction(name, table, figure, [f"{title}.", *_made_by(found), note])


def _chosen(result: Result, swept: Sequence[str], without: Sequence[str]) -> str:
    """A run's values of the swept keys, in words."""
    pairs = [(key, result.chosen[key]) for key in swept if key in result.chosen]
    return ", ".join(f"{key.rpartition('.')[2]} {v}" for key, v in pairs if key not in without)


def _measured_on(result: Result) -> str:
    data: Mapping[str, object] = result.config["data"]
    root = Path(str(data["root"])).name if data.get("root") else ""
    where = f"{root} ({data['name']})" if root else f"{data['name']} data"
    return f"{result.summary['targets']} targets in {result.frames} frames of {where}"


def _made_by(found: ResultSet) -> list[str]:
    missing = f"Unfinished runs of the sweep, left out: {len(found.unfinished)}."
    return [f"Made by `{found.command}`.", *([missing] if found.unfinished else [])]
