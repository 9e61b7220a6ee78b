"""Reports of single experiments: the paper's figures and tables, recordings, ladder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.files import write_csv, write_text
from hlp.reporting import bop_table as bop
from hlp.reporting import comparison, recordings
from hlp.reporting import paper_reports as paper
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import Bar, Panel, draw_bars, gain_bar, recall_bar
from hlp.reporting.results import Result, left_out_if_broken, result_folders
from hlp.reporting.summary_tables import ADD_CELLS, BOP_RECALLS, run_cells
from hlp.reporting.sweeps import Sweep, read_sweeps
from hlp.reporting.table import Table, format_share, lay_out, prose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = "figures.csv"
"""The main figures of an experiment, in the form of `docs/results/`."""
LADDER, RECORDINGS = "ladder", "recordings"
"""Names of experiments, and of the files of their tables; of the config group `ladder`, too."""
_LADDER_NOTE = (
    "Each step differs by one decision from that under *against*; what it gains is over the"
    " targets of both, with the 95 % interval of the paired bootstrap over blocks of neighbouring"
    " frames. AR: BOP's average recall. ms: median for one object in one frame."
)


@dataclass(frozen=True)
class Report:
    """A table with its caption, `notes`, and a figure; a terminal does not show its `wide` columns.

    `figures` is what figures.csv holds.
    """

    name: str
    table: Table
    notes: list[str]
    figure: "Figure | None"
    figures: Table | None = None
    wide: Sequence[str] = ()


def reports_of(folder: Path) -> list[Report]:
    """The reports of the experiments among the results of a sweep or run."""
    made = []
    sweeps = read_sweeps(folder)
    for name, found in {run.experiment: sweep for sweep in sweeps for run in sweep.results}.items():
        results = [result for result in found.results if result.experiment == name]
        if name in paper.TRENDS:
            made.append(_trend(name, results, found))
        elif name in paper.TABLES:
            made.append(_table(name, results, found))
        elif name == RECORDINGS:
            made.append(_recordings(results, found))
        elif name == LADDER:
            steps = {result.chosen[LADDER]: result for result in results if LADDER in result.chosen}
            made += [_ladder(steps, found)] if steps else []
    if sweeps and (runs := bop.bop_runs(folder)):
        made.append(Report(bop.BOP, bop.bop_table(runs), [*_made_by(sweeps[0]), bop.NOTE], None))
    return made


def write_reports(folder: Path) -> list[Path]:
    """Write the reports of a sweep or run: NAME.md, .csv, .tex, .png and .svg; those files.

    figures.csv holds the main figures, as result files keep them.
    """
    return [path for made in reports_of(folder) for path in _write(folder, made)]


def describe_reports(root: Path, layout: str) -> str:
    """Write every report that there are runs for in or below a folder; captions, tables, files.

    Empty if there is none. `layout` is `text` or `markdown`.
    """
    parts, folders = list[str](), result_folders(root)
    for folder in folders:
        found = list[Report]()
        with left_out_if_broken(len(folders) == 1):
            found = reports_of(folder)
        for made in found:
            files = ", ".join(str(path) for path in _write(folder, made))
            shown = made.table.without(*made.wide) if layout == "text" else made.table
            parts += [prose(words, layout) for words in made.notes]
            parts += [lay_out(shown, layout), prose(f"Written: {files}", layout)]
    return "\n\n".join(parts)


def _write(folder: Path, made: Report) -> list[Path]:
    markdown, rows, latex = (folder / f"{made.name}.{ending}" for ending in ("md", "csv", "tex"))
    written = save_figure(made.figure, folder / made.name) if made.figure else []
    picture = [f"![{made.name}]({written[1].name})"] if written else []
    write_text(markdown, "\n\n".join([*picture, *made.notes, made.table.markdown()]) + "\n")
    write_csv(rows, made.table.header, made.table.rows)
    write_text(latex, made.table.latex() + "\n")
    written += [markdown, rows, latex]
    if made.name == bop.BOP:
        written += bop.write_server_files(folder)
    if made.figures is not None:
        write_csv(folder / FIGURES, made.figures.header, made.figures.rows)
        written.append(folder / FIGURES)
    return written


def _made_by(found: Sweep) -> list[str]:
    missing = f"Unfinished runs of the sweep, left out: {len(found.unfinished)}."
    return [f"Made by `{found.command}`.", *([missing] if found.unfinished else [])]


def _trend(name: str, results: Sequence[Result], found: Sweep) -> Report:
    trend, data = paper.TRENDS[name], paper.measured_on(results[0])
    others = [key for key in found.keys if key not in trend.keys]
    words = [result.in_words(others) for result in results]
    runs = sorted(zip(words, results, strict=True), key=lambda run: words.index(run[0]))
    notes = [f"{trend.title}, {data}.", *_made_by(found), paper.trend_note(trend)]
    table, figures = paper.trend_tables(trend, runs)
    return Report(name, table, notes, paper.draw_trend(trend, runs, data), figures)


def _table(name: str, results: Sequence[Result], found: Sweep) -> Report:
    runs = {result.in_words(found.keys) or "ours": result for result in results}
    title, note = f"{paper.TABLES[name]}, {paper.measured_on(results[0])}", paper.NOTES[name]
    if name == "table1":
        recalls, table = paper.object_recalls(runs), paper.object_recalls_table(runs)
    else:
        recalls = paper.metric_recalls(runs)
        table = recalls.table("recall")
    return Report(name, table, [f"{title}.", *_made_by(found), note], recalls.figure(title, note))


def _ladder(runs: Mapping[str, Result], found: Sweep) -> Report:
    """A row a step: recalls, and what it gained against the one before it."""
    shown = ["ADD(-S)", "95 %", "5cm5deg", "IoU.5", "AR", "ms", "load"]
    of_figures = {**ADD_CELLS, "5cm5deg": "5cm5deg", "iou50": "IoU.5", "ar": "AR"}
    rows, figures, gains = [], [], []
    for name, result in runs.items():
        change, before = (result.config["step"][key] or "" for key in ("change", "before"))
        start, cells, hidden = runs.get(before), run_cells(result.summary), result.hidden_targets
        gain = comparison.paired_difference(start.verdicts, result.verdicts) if start else None
        gains.append(gain_bar(gain))
        gained = ["–"] * 4
        if start and gain:
            more = result.total_ms["median"] - start.total_ms["median"]
            gained = [before, *comparison.difference_cells(gain), f"{more:+.0f}"]
        rows.append([name, change, *(cells[column] for column in shown), *gained])
        of_hidden = format_share(comparison.recall_of(hidden, "add") if hidden else None)
        recalls = [*(cells[column] for column in of_figures.values()), of_hidden]
        against = before if gain else ""
        figures.append([name, change, *recalls, against, *comparison.with_ends(gain)])
    table = Table(["step", "change", *shown, "against", "gained", "95 % of it", "ms more"], rows)
    header = ["step", "change", *of_figures, f"visible_below_{comparison.WELL_VISIBLE:g}"]
    header += ["from", "gain", "gain_low", "gain_high"]
    notes, wide = [*_made_by(found), _LADDER_NOTE], ["change", *shown[1:5], "load"]
    return Report(LADDER, table, notes, _draw_ladder(runs, gains), Table(header, figures), wide)


def _draw_ladder(runs: Mapping[str, Result], gains: Sequence[Bar | None]) -> "Figure":
    """A row a step in words, the first at the top: recall on the left, the gain on the right.

    A line leads to each recall from that of the step that it starts from, so branches are seen.
    """
    recalls = {name: recall_bar(result.add) for name, result in runs.items()}
    panels = [Panel("ADD(-S) recall, 95 % interval", {"": [*recalls.values()]}, recall=True)]
    if any(gains):
        panels.append(Panel("gained against the step that it starts from", {"": gains}))
    changes = [result.config["step"]["change"] or "" for result in runs.values()]
    figure = draw_bars(changes, panels, paper.measured_on(next(iter(runs.values()))))
    rows = {name: row for row, name in enumerate(runs)}
    for name, result in runs.items():
        before = result.config["step"]["before"]
        if before in runs:
            ends = [recalls[step].value for step in (before, name)], [rows[before], rows[name]]
            figure.axes[0].plot(*ends, color="0.6", linewidth=0.9, zorder=0)
    return figure


def _recordings(results: Sequence[Result], found: Sweep) -> Report:
    keys = [*dict.fromkeys((recordings.DATA, *found.keys))]
    repeats = recordings.repeats_of(results, keys)
    table = recordings.recordings_table(repeats, keys)
    spread = " spread: standard deviation between seeds." if recordings.SEED in keys else ""
    notes, wide = [*_made_by(found), recordings.NOTE + spread], ["frames", "5cm5deg"]
    figure, figures = recordings.draw_scores(repeats), recordings.recording_figures(repeats)
    wide += map(str.upper, BOP_RECALLS)
    return Report(RECORDINGS, table, notes, figure, figures, wide)
