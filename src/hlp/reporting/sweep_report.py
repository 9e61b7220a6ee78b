"""What every sweep ends with: a table, a figure, a sentence, and the same in MLflow."""

import textwrap
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from hlp.files import write_csv, write_text
from hlp.reporting.comparison import difference_cells
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import Bar, Panel, draw_bars, gain_bar, run_panels
from hlp.reporting.figures.charts import recall_by_time
from hlp.reporting.figures.heat_maps import HeatMap, draw_heat_maps
from hlp.reporting.mlflow.pages import headline_metrics
from hlp.reporting.mlflow.run import MlflowRun
from hlp.reporting.study_numbers import ADD, KINDS, RUN
from hlp.reporting.summary_tables import run_numbers
from hlp.reporting.sweeps import Sweep, SweepRun, short_key
from hlp.reporting.table import Table, format_interval, lay_out, prose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BEST = "Starred is the best by {}; of ties the default, if it is one of them."
_PAIRED = (
    "Differences are over the targets of both runs, with the 95 % interval of the paired bootstrap"
    " over blocks of neighbouring frames."
)


def sweep_table(sweep: Sweep, *, whole: bool = True) -> Table:
    """A row a run: its values and numbers; the best run has a `*`.

    The main numbers' differences to the reference follow, with their intervals. `whole`: also what
    does not fit a terminal.
    """
    numbers = {name: n for name, n in sweep.numbers.items() if whole or not n.more}
    names = list(numbers) or [ADD]
    with_interval = {name for name, n in numbers.items() if n.interval and (whole or n.main)}
    compared, several = sweep.mains, len(sweep.mains) > 1
    if several:
        compared = [name for name in compared if name in sweep.differences]
    keys = [short_key(key) for key in sweep.keys] or ["run"]
    header = keys if whole else [", ".join(keys)]
    for name in names:
        header += [name, "95 %"] if name in with_interval else [name]
    for name in compared:
        header += [f"{name} " * several + f"to {sweep.against}", "95 % of it"]
    rows = []
    for run in sweep.runs:
        row = _values(sweep, run, whole)
        for name in names:
            number = run.numbers.get(name)
            row.append(number.text if number else "")
            if name in with_interval:
                row.append(format_interval((number and number.interval) or ()))
        for name in compared:
            row += _difference_cells(sweep, run, name)
        if not run.numbers:
            row[header.index(sweep.first_main or names[0])] = "no result"
        rows.append(row)
    return Table(header, rows)


def _values(sweep: Sweep, run: SweepRun, whole: bool) -> list[str]:
    """Values of the swept keys: in a column each or, for a terminal, in one for all."""
    values = [run.values.get(key, "") for key in sweep.keys] or [run.folder.name]
    values = values if whole else [", ".join(values)]
    return [*values[:-1], f"{values[-1]} *" if run is sweep.best else values[-1]]


def _difference_cells(sweep: Sweep, run: SweepRun, name: str) -> list[str]:
    if not run.numbers:
        return ["", ""]
    if run is sweep.reference:
        return [sweep.against, ""]
    found = sweep.difference(run, name)
    return ["–", ""] if found is None else difference_cells(found)


def note_of(sweep: Sweep) -> str:
    """What the columns and marks of the tables mean."""
    best = [_BEST.format(sweep.first_main)] if sweep.best is not None else []
    paired = [_PAIRED] if sweep.differences else []
    return " ".join([*best, *paired, KINDS[sweep.name].note])


def describe_sweep(sweep: Sweep, layout: str) -> str:
    """The runs for people (`text`, which fits a terminal, or `markdown`) with what columns mean.

    A terminal shows the end first, a page the beginning: the verdict stands there.
    """
    whole = layout != "text"
    table = lay_out(sweep_table(sweep, whole=whole), layout)
    note, verdict = (prose(words, layout) for words in (note_of(sweep), sweep.verdict))
    return "\n\n".join([verdict, table, note] if whole else [table, note, verdict])


def write_sweep(folder: Path, sweep: Sweep) -> list[Path]:
    """Write NAME.md, NAME.csv and, if a run has finished, NAME.png and NAME.svg; those files.

    NAME is `sweep`, or that of the study. Of two or more plain runs also recall_by_time.
    """
    markdown, rows = folder / f"{sweep.name}.md", folder / f"{sweep.name}.csv"
    described = describe_sweep(sweep, "markdown")
    write_text(markdown, f"{described}\n\nMade by `{sweep.command}`.\n")
    table = sweep_table(sweep)
    write_csv(rows, table.header, table.rows)
    figure = sweep_figure(sweep)
    drawn = save_figure(figure, folder / sweep.name) if figure else []
    if len(sweep.results) > 1:
        figure = recall_by_time(sweep.results, sweep.keys)
        drawn += save_figure(figure, folder / "recall_by_time")
    return [markdown, rows, *drawn]


def sweep_figure(sweep: Sweep) -> "Figure | None":
    """Heat maps for two keys, bars otherwise; None without any result."""
    if not sweep.finished:
        return None
    complete = all(key in run.values for key in sweep.keys for run in sweep.finished)
    if sweep.name == RUN and len(sweep.keys) == 2 and complete:
        return _grid(sweep)
    rows = [f"{run.short_label}{' *' * (run is sweep.best)}" for run in sweep.finished]
    panels = _number_panels(sweep)
    if sweep.name == RUN:
        panels = run_panels([result.summary for result in sweep.results])
        name = sweep.first_main
        bars = [gain_bar(sweep.difference(run, name)) for run in sweep.finished]
        if any(bars):
            panels.insert(1, Panel(f"{name} recall minus that of the {sweep.against}", {"": bars}))
    marked = [row for row, run in enumerate(sweep.finished) if run is sweep.reference]
    return draw_bars(rows, panels, sweep.verdict, marked=marked if sweep.is_default else ())


def _number_panels(sweep: Sweep) -> list[Panel]:
    """A panel for each kind of number of studies."""
    kinds: dict[tuple[str, bool], dict[str, list[Bar | None]]] = {}
    for name, number in sweep.numbers.items():
        if number.panel:
            found = [run.numbers.get(name) for run in sweep.finished]
            bars = [Bar(n.value, n.text, n.interval) if n else None for n in found]
            kinds.setdefault((number.panel, number.is_recall), {})[name] = bars
    return [Panel(title, series, recall) for (title, recall), series in kinds.items()]


def _grid(sweep: Sweep) -> "Figure":
    """Recall left and time right, a cell for each pair of values; the load where it differs."""
    across, down = sweep.keys
    runs = [(run.values, run.result.summary) for run in sweep.finished if run.result]
    found = pd.DataFrame([{**values, **run_numbers(summary)} for values, summary in runs])
    cells = partial(found.pivot_table, index=down, columns=across, sort=False)
    recalls, times = cells(ADD), cells("ms")
    maps = [
        HeatMap("ADD(-S) recall", recalls.to_numpy()),
        HeatMap("ms, median", times.to_numpy(), "{:.0f}".format, "viridis_r"),
    ]
    if found["load"].nunique() > 1:
        loads = cells("load").to_numpy()
        maps.append(HeatMap("load of the machine", loads, "{:.1f}".format, "viridis_r"))
    marked = None
    if sweep.reference is not None and sweep.is_default:
        of_default = (sweep.reference.values[key] for key in (down, across))
        axes = recalls.index, recalls.columns
        marked = tuple(axis.get_loc(value) for axis, value in zip(axes, of_default, strict=True))
    named = [*recalls.index], [*recalls.columns]
    return draw_heat_maps(maps, *named, (across, down), textwrap.fill(sweep.verdict, 80), marked)


def log_sweeps(sweeps: Sequence[Sweep], written: Sequence[Path], tracker: MlflowRun) -> None:
    """Log the runs of a sweep and its files, the figures also as images.

    The sweep's own MLflow run has the numbers of its best run.
    """
    tracker.describe("\n\n".join(describe_sweep(sweep, "markdown") for sweep in sweeps))
    for sweep in sweeps:
        steps = steps_of(sweep.keys, [run.values for run in sweep.finished])
        for step, run in zip(steps, sweep.finished, strict=True):
            named = {f"{sweep.name}/{name}": n.value for name, n in run.numbers.items()}
            metrics = headline_metrics(run.result.summary) if run.result else named
            tracker.log_metrics({f"{RUN}/{name}": value for name, value in metrics.items()}, step)
        if sweep.best is not None:
            tracker.set_tags({"best_run": sweep.winner})
            if sweep.best.result is not None:
                tracker.log_metrics(headline_metrics(sweep.best.result.summary))
    for path in written:
        tracker.log_artifact(path)
        if path.suffix == ".png":
            tracker.log_image(path, f"figures/{path.stem}", 0)


def steps_of(keys: Sequence[str], runs: Sequence[Mapping[str, str]]) -> list[int]:
    """A step for each run: its value, if one key has whole numbers; else its place.

    So MLflow draws recall over the number of particles by itself.
    """
    values = [run.get(keys[0], "") for run in runs] if keys else []
    whole = len(keys) == 1 and all(value.isdecimal() for value in values)
    if whole and len({int(value) for value in values}) == len(values):
        return [int(value) for value in values]
    return list(range(len(runs)))
