"""The paper's figures and tables of finished runs: its numbers beside ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.reporting.figures.sweep_bars import TRENDS, draw_trend, trend_note, trend_table
from hlp.reporting.paper_tables import (
    METRICS_NOTE,
    OBJECTS_NOTE,
    draw_sources,
    metric_sources,
    metrics_table,
    object_sources,
    objects_of,
    objects_table,
)
from hlp.reporting.results import Result, ResultSet, read_results, result_folders
from hlp.reporting.tables import FORMATS, METRICS, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLES = {"table1": "Table 1: AD recall", "table2": "Table 2: recall"}
"""The tables by the name of their experiment."""
_ENDINGS = ("png", "svg", "md", "csv", "tex")


@dataclass(frozen=True)
class Reproduction:
    """A figure and a table of the paper, made anew; `notes` say what stands in them."""

    name: str
    table: Table
    figure: "Figure"
    notes: list[str]


def describe_reproductions(root: Path, layout: str) -> str:
    """Make anew what the runs in or below a folder are of; their tables and files for people.

    Empty where no run is of a figure or table of the paper. `layout` is `text` or `markdown`.
    """
    parts = []
    for folder in result_folders(root):
        for made in reproduce(read_results(folder)):
            files = ", ".join(str(path) for path in write_reproduction(folder, made))
            parts += [*made.notes, FORMATS[layout](made.table), f"Written: {files}"]
    return "\n\n".join(parts)


def write_reproductions(folder: Path) -> list[Path]:
    """Make anew what one sweep or run is of, into its folder; the files."""
    made = reproduce(read_results(folder))
    return [path for each in made for path in write_reproduction(folder, each)]


def reproduce(found: ResultSet) -> list[Reproduction]:
    """The figure or table of the paper that results are of, one for each experiment among them."""
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
    import matplotlib

    files = [folder / f"{made.name}.{ending}" for ending in _ENDINGS]
    with matplotlib.rc_context({"svg.hashsalt": "hlp"}):  # equal figures, equal files
        made.figure.savefig(files[0], dpi=150)
        made.figure.savefig(files[1], metadata={"Date": None})
    picture = f"![{made.name}]({files[1].name})"
    files[2].write_text("\n\n".join([picture, *made.notes, made.table.markdown()]) + "\n")
    files[3].write_text(made.table.csv() + "\n")
    files[4].write_text(made.table.latex() + "\n")
    return files


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
        table, note = objects_table(runs), OBJECTS_NOTE
        figure = draw_sources(objects_of(runs), object_sources(runs), title, note)
    else:
        table, note = metrics_table(runs), METRICS_NOTE
        figure = draw_sources([*METRICS.values()], metric_sources(runs), title, note)
    return Reproduction(name, table, figure, [f"{title}.", *_made_by(found), note])


def _chosen(result: Result, swept: Sequence[str], without: Sequence[str]) -> str:
    """What a run has for the swept keys, in words."""
    pairs = [(key, result.chosen[key]) for key in swept if key in result.chosen]
    return ", ".join(f"{key.rpartition('.')[2]} {v}" for key, v in pairs if key not in without)


def _measured_on(result: Result) -> str:
    data: Mapping[str, object] = result.config["data"]
    root = Path(str(data["root"])).name if data.get("root") else ""
    where = f"{root} ({data['name']})" if root else f"{data['name']} data"
    return f"{result.summary['targets']} targets in {result.frames} frames of {where}"


def _made_by(found: ResultSet) -> list[str]:
    left = f"Arms that are not finished and left out: {found.unfinished}."
    return [f"Made by `{found.command}`.", *([left] if found.unfinished else [])]
