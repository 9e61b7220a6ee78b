"""Reports of single experiments: the paper's figures and tables, recordings, ladder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

from hlp.files import write_csv, write_text
from hlp.reporting.comparison import WELL_VISIBLE, mean_and_spread, recall_of
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.ladder import (
    LADDER,
    LADDER_NOTE,
    draw_ladder,
    ladder_tables,
    step_figures,
    steps_of_ladder,
)
from hlp.reporting.paper_reports import (
    NOTES,
    TABLES,
    TRENDS,
    draw_trend,
    measured_on,
    metric_recalls,
    object_recalls,
    object_recalls_table,
    trend_figures,
    trend_note,
    trend_table,
)
from hlp.reporting.results import Result, ResultSet, read_results, result_folders
from hlp.reporting.tables.summary_tables import BOP_RECALLS, METRIC_LABELS, run_cells
from hlp.reporting.tables.table import Table, lay_out, prose, result_share

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RECORDINGS = "recordings"
"""Name of an experiment, and of the files of its table."""
FIGURES = "figures.csv"
"""The main figures of an experiment, in the form of `docs/results/`."""


@dataclass(frozen=True)
class Report:
    """A table with its caption, `notes`, and a figure; `narrow` is the table for a terminal.

    `figures` is what figures.csv holds.
    """

    name: str
    table: Table
    notes: list[str]
    figure: "Figure | None" = None
    narrow: Table | None = None
    figures: Table | None = None


def reports_of(found: ResultSet) -> list[Report]:
    """The reports of the experiments among some results."""
    made = []
    for name in dict.fromkeys(result.experiment for result in found.results):
        results = [result for result in found.results if result.experiment == name]
        if name in TRENDS:
            made.append(_trend(name, results, found))
        elif name in TABLES:
            made.append(_table(name, results, found))
        elif name == RECORDINGS:
            made.append(_recordings(results, found))
        elif name == LADDER and (steps := steps_of_ladder(results)):
            table, narrow = ladder_tables(steps)
            notes, figure = [*_made_by(found), LADDER_NOTE], draw_ladder(steps)
            made.append(Report(LADDER, table, notes, figure, narrow, step_figures(steps)))
    return made


def write_reports(folder: Path) -> list[Path]:
    """Write the reports of a sweep or run: NAME.md, .csv, .png and .svg; those files.

    The paper's also as NAME.tex. figures.csv holds the main figures, as result files keep them.
    """
    return [path for made in reports_of(read_results(folder)) for path in _write(folder, made)]


def describe_reports(root: Path, layout: str) -> str:
    """Write every report that there are runs for in or below a folder; captions, tables, files.

    Empty if there is none. `layout` is `text` or `markdown`.
    """
    parts = []
    for folder in result_folders(root):
        for made in reports_of(read_results(folder)):
            files = ", ".join(str(path) for path in _write(folder, made))
            shown = made.narrow if layout == "text" and made.narrow else made.table
            parts += [prose(words, layout) for words in made.notes]
            parts += [lay_out(shown, layout), prose(f"Written: {files}", layout)]
    return "\n\n".join(parts)


def _write(folder: Path, made: Report) -> list[Path]:
    markdown, rows, latex = (folder / f"{made.name}.{ending}" for ending in ("md", "csv", "tex"))
    written = save_figure(made.figure, folder / made.name) if made.figure else []
    picture = [f"![{made.name}]({written[1].name})"] if written else []
    write_text(markdown, "\n\n".join([*picture, *made.notes, made.table.markdown()]) + "\n")
    write_csv(rows, made.table.header, made.table.rows)
    written += [markdown, rows]
    if made.name in {*TRENDS, *TABLES}:
        write_text(latex, made.table.latex() + "\n")
        written.append(latex)
    if made.figures is not None:
        write_csv(folder / FIGURES, made.figures.header, made.figures.rows)
        written.append(folder / FIGURES)
    return written


def _made_by(found: ResultSet) -> list[str]:
    missing = f"Unfinished runs of the sweep, left out: {len(found.unfinished)}."
    return [f"Made by `{found.command}`.", *([missing] if found.unfinished else [])]


def _in_words(result: Result, swept: Sequence[str], without: Sequence[str] = ()) -> str:
    """A run's values of the swept keys."""
    pairs = [(key, result.chosen[key]) for key in swept if key in result.chosen]
    return ", ".join(f"{key.rpartition('.')[2]} {v}" for key, v in pairs if key not in without)


def _trend(name: str, results: Sequence[Result], found: ResultSet) -> Report:
    trend, data = TRENDS[name], measured_on(results[0])
    words = [_in_words(result, found.swept, trend.keys) for result in results]
    runs = sorted(zip(words, results, strict=True), key=lambda run: words.index(run[0]))
    notes = [f"{trend.title}, {data}.", *_made_by(found), trend_note(trend)]
    figure, figures = draw_trend(trend, runs, data), trend_figures(trend, runs)
    return Report(name, trend_table(trend, runs), notes, figure, figures=figures)


def _table(name: str, results: Sequence[Result], found: ResultSet) -> Report:
    runs = {_in_words(result, found.swept) or "ours": result for result in results}
    title, note = f"{TABLES[name]}, {measured_on(results[0])}", NOTES[name]
    if name == "table1":
        recalls, table = object_recalls(runs), object_recalls_table(runs)
    else:
        recalls = metric_recalls(runs)
        table = recalls.table("recall")
    notes = [f"{title}.", *_made_by(found), note]
    return Report(name, table, notes, recalls.figure(title, note))


_DATA, _SEED = "data", "seed"
_NOTE = (
    "ADD(-S): ADD-S for objects with a symmetry, ADD for the others. AR: mean of BOP's average"
    " recalls VSD, MSSD and MSPD. ECE: expected calibration error of the score. ms: median for one"
    " object in one frame."
)


def _recordings(results: Sequence[Result], found: ResultSet) -> Report:
    """A row a data set: its size, recalls, BOP's average recalls, time of one object (ms).

    Further keys that were swept have a column each. Of several seeds, their mean and their spread
    (standard deviation) follow.
    """
    keys = [_DATA, *(key for key in found.swept if key != _DATA)]
    bop = [*map(str.upper, BOP_RECALLS)]
    measured = ["frames", "targets", "ADD(-S)", "95 %", "5cm5deg", "AR", *bop, "ECE", "ms"]
    repeats: dict[tuple[str, ...], list[Result]] = {}
    for result in results:
        same = tuple(_values(result, [key for key in keys if key != _SEED]).values())
        repeats.setdefault(same, []).append(result)
    rows = [row for same in repeats.values() for row in _repeat_rows(same, keys)]
    header = [*keys, *measured]
    table = Table(header, [[row.get(name, "") for name in header] for row in rows])
    spread = [" spread: standard deviation between seeds."] if _SEED in keys else []
    notes = [*_made_by(found), "".join([_NOTE, *spread])]
    narrow = table.without("frames", *bop).fitted(0)
    figures = recording_figures({", ".join(same): runs for same, runs in repeats.items()})
    return Report(RECORDINGS, table, notes, None, narrow, figures)


def _values(result: Result, keys: Sequence[str]) -> dict[str, str]:
    """Values of the swept keys; of the data, the name at least."""
    own = {_DATA: str(result.config[_DATA]["name"]), **result.chosen}
    return {key: own.get(key, "") for key in keys}


def _repeat_rows(repeats: Sequence[Result], keys: Sequence[str]) -> list[dict[str, str]]:
    """A row a result; of several, which differ by their seeds, also their mean and spread."""
    rows = [
        {"frames": str(result.frames), **run_cells(result.summary), **_values(result, keys)}
        for result in repeats
    ]
    if _SEED not in keys or len(repeats) < 2:
        return rows
    means, spreads = mean_and_spread([_shares(result.summary) for result in repeats])
    times = [result.total_ms["median"] for result in repeats]
    for name, shares, time in (("mean", means, fmean(times)), ("spread", spreads, stdev(times))):
        rows.append({**_values(repeats[0], keys), **shares, _SEED: name, "ms": f"{time:.0f}"})
    return rows


def _shares(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Recalls by ADD(-S) and 5cm5deg, BOP's, and the error of the scores; None if not known."""
    recalls = {METRIC_LABELS[key]: summary["metrics"][key]["recall"] for key in ("add", "5cm5deg")}
    bop = {key.upper(): summary.get("bop", {}).get(key) for key in ("ar", *BOP_RECALLS)}
    return {**recalls, **bop, "ECE": summary.get("calibration", {}).get("ece")}


def recording_figures(repeats: Mapping[str, Sequence[Result]]) -> Table:
    """A row a data set: recalls by seed, and means over them; another for its hidden targets.

    The interval is that of the first seed.
    """
    seeds = sorted({result.seed for own in repeats.values() for result in own})
    rows = []
    for data, own in repeats.items():
        shares = {result.seed: _shares(result.summary) for result in own}
        ends = [*map(result_share, own[0].add["ci95"])]
        rows.append([data, str(own[0].targets), *_mean_cells(shares, seeds, ends)])
        hidden = {result.seed: targets for result in own if (targets := result.hidden_targets)}
        if hidden:
            name, count = f"{data} below {WELL_VISIBLE:g} visible", len(hidden[own[0].seed])
            recalls: dict[str, dict[str, float | None]] = {
                seed: {METRIC_LABELS[key]: recall_of(targets, key) for key in ("add", "5cm5deg")}
                for seed, targets in hidden.items()
            }
            rows.append([name, str(count), *_mean_cells(recalls, seeds, ["", ""])])
    by_seed = [f"add_seed_{seed}" for seed in seeds]
    means = ["add", "add_low", "add_high", "5cm5deg", "ar", "ece"]
    return Table(["data", "targets", *by_seed, *means], rows)


def _mean_cells(
    shares: Mapping[str, Mapping[str, float | None]], seeds: Sequence[str], ends: Sequence[str]
) -> list[str]:
    by_seed = [result_share(shares.get(seed, {}).get("ADD(-S)")) for seed in seeds]
    means, _ = mean_and_spread([*shares.values()])
    add, *others = (
        means.get(name, "").replace("0.", ".", 1) for name in ("ADD(-S)", "5cm5deg", "AR", "ECE")
    )
    return [*by_seed, add, *ends, *others]
