"""Reports of single experiments: the paper's figures and tables, recordings, ladder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

from hlp.files import SCORES, write_csv, write_text
from hlp.reporting.comparison import Difference, mean_and_spread, paired_difference, read_targets
from hlp.reporting.figures.bars import Bar, Panel, draw_bars, recall_bar
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.paper_reports import (
    METRICS_NOTE,
    OBJECTS_NOTE,
    TABLES,
    TRENDS,
    draw_recalls,
    draw_trend,
    measured_on,
    metric_columns,
    metric_recalls_table,
    object_columns,
    object_recalls_table,
    objects_of,
    trend_note,
    trend_table,
)
from hlp.reporting.results import Result, ResultSet, read_results, result_folders
from hlp.reporting.tables.summary_tables import BOP_RECALLS, METRIC_LABELS, run_cells
from hlp.reporting.tables.table import Table, lay_out, prose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RECORDINGS, LADDER = "recordings", "ladder"
"""Names of two experiments, and of the files of their tables."""


@dataclass(frozen=True)
class Report:
    """A table with its caption, `notes`, and a figure; `narrow` is the table for a terminal."""

    name: str
    table: Table
    notes: list[str]
    figure: "Figure | None" = None
    narrow: Table | None = None


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
            made.append(_ladder(steps, found))
    return made


def write_reports(folder: Path) -> list[Path]:
    """Write the reports of a sweep or run: NAME.md, .csv, .png and .svg; those files.

    The paper's also as NAME.tex.
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


def describe_table(folder: Path) -> str:
    """The paper's table that a sweep or run belongs to, for a terminal; empty if to none."""
    parts = []
    for made in reports_of(read_results(folder)):
        if made.name in TABLES:
            title, note = (prose(made.notes[place], "text") for place in (0, -1))
            parts += [title, lay_out(made.table, "text"), note]
    return "\n\n".join(parts)


def _write(folder: Path, made: Report) -> list[Path]:
    markdown, rows, latex = (folder / f"{made.name}.{ending}" for ending in ("md", "csv", "tex"))
    drawn = save_figure(made.figure, folder / made.name) if made.figure else []
    picture = [f"![{made.name}]({drawn[1].name})"] if drawn else []
    write_text(markdown, "\n\n".join([*picture, *made.notes, made.table.markdown()]) + "\n")
    write_csv(rows, made.table.header, made.table.rows)
    if made.name not in {*TRENDS, *TABLES}:
        return [*drawn, markdown, rows]
    write_text(latex, made.table.latex() + "\n")
    return [*drawn, markdown, rows, latex]


def _made_by(found: ResultSet) -> list[str]:
    missing = f"Unfinished runs of the sweep, left out: {len(found.unfinished)}."
    return [f"Made by `{found.command}`.", *([missing] if found.unfinished else [])]


def _in_words(result: Result, swept: Sequence[str], without: Sequence[str] = ()) -> str:
    """A run's values of the swept keys."""
    pairs = [(key, result.chosen[key]) for key in swept if key in result.chosen]
    return ", ".join(f"{key.rpartition('.')[2]} {v}" for key, v in pairs if key not in without)


def _trend(name: str, results: Sequence[Result], found: ResultSet) -> Report:
    trend, data = TRENDS[name], measured_on(results[0])
    series: dict[str, list[Result]] = {}
    for result in results:
        series.setdefault(_in_words(result, found.swept, trend.keys), []).append(result)
    notes = [f"{trend.title}, {data}.", *_made_by(found), trend_note(trend)]
    return Report(name, trend_table(trend, series), notes, draw_trend(trend, series, data))


def _table(name: str, results: Sequence[Result], found: ResultSet) -> Report:
    runs = {_in_words(result, found.swept) or "ours": result for result in results}
    title = f"{TABLES[name]}, {measured_on(results[0])}"
    if name == "table1":
        table, note = object_recalls_table(runs), OBJECTS_NOTE
        rows, columns = objects_of(runs), object_columns(runs)
    else:
        table, note = metric_recalls_table(runs), METRICS_NOTE
        rows, columns = [*METRIC_LABELS.values()], metric_columns(runs)
    notes = [f"{title}.", *_made_by(found), note]
    return Report(name, table, notes, draw_recalls(rows, columns, title, note))


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
    return Report(RECORDINGS, table, notes, None, table.without("frames", *bop).fitted(0))


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


@dataclass(frozen=True)
class LadderStep:
    """One run of the ladder: what it changes, and what it gains against the run it starts from."""

    name: str
    change: str
    before: str
    result: Result
    gain: Difference | None
    milliseconds: float


def steps_of_ladder(results: Sequence[Result]) -> list[LadderStep]:
    """The steps among some results, in the order of the sweep."""
    runs = {result.chosen[LADDER]: result for result in results if LADDER in result.chosen}
    verdicts = {
        name: {
            key: float(target.correct("add"))
            for key, target in read_targets(result.folder / SCORES).items()
        }
        for name, result in runs.items()
    }
    steps = []
    for name, result in runs.items():
        given: Mapping[str, str | None] = result.config["arm"]
        before = given["before"] or ""
        gain = paired_difference(verdicts.get(before, {}), verdicts[name], "verdict")
        other = runs.get(before, result).total_ms["median"]
        spent = result.total_ms["median"] - other
        steps.append(LadderStep(name, given["change"] or "", before, result, gain, spent))
    return steps


def _ladder(steps: Sequence[LadderStep], found: ResultSet) -> Report:
    against = ["against", "ADD(-S) gained", "95 % of it", "ms more"]
    wide = ["change", "95 %", "5cm5deg", "IoU", "AR"]  # for which a terminal has no room
    shown = ["ADD(-S)", "95 %", "5cm5deg", "IoU.5", "AR", "ms"]
    rows = []
    for step in steps:
        cells, gained = run_cells(step.result.summary), ["–"] * len(against)
        if step.gain is not None:
            recall, (low, high) = step.gain
            interval = f"{low:+.3f} to {high:+.3f}"
            gained = [step.before, f"{recall:+.3f}", interval, f"{step.milliseconds:+.0f}"]
        rows.append([step.name, step.change, *(cells[name] for name in shown), *gained])
    header = ["arm", "change", *(name.removesuffix(".5") for name in shown), *against]
    table = Table(header, rows)
    narrow = table.without(*wide)
    names = [name.removeprefix("ADD(-S) ") for name in narrow.header]
    note = (
        "Each step differs by one decision from that under *against*; what it gains is over the"
        " targets of both, with the 95 % interval of the paired bootstrap over blocks of"
        " neighbouring frames. AR: BOP's average recall. ms: median for one object in one frame."
    )
    notes = [*_made_by(found), note]
    fitted = Table(names, narrow.rows).fitted(0, names.index("against"))
    return Report(LADDER, table, notes, _draw_ladder(steps), fitted)


def _draw_ladder(steps: Sequence[LadderStep]) -> "Figure":
    """A row a step, the first at the top: recall on the left, the gain on the right."""
    recalls = [recall_bar(step.result.add) for step in steps]
    gains = [
        None if step.gain is None else Bar(step.gain[0], f"{step.gain[0]:+.3f}", step.gain[1])
        for step in steps
    ]
    panels = [Panel("ADD(-S) recall, 95 % interval", {"": recalls}, recall=True)]
    if any(gains):
        panels.append(Panel("gained against the step that it starts from", {"": gains}))
    return draw_bars([step.name for step in steps], panels, measured_on(steps[0].result))
