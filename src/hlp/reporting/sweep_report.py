"""What every sweep ends with: a table, a figure, a sentence, and the same in MLflow."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hlp.files import write_csv, write_text
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import (
    Bar,
    Panel,
    draw_bars,
    gain_bar,
    run_panels,
)
from hlp.reporting.figures.charts import draw_trade_off
from hlp.reporting.figures.heat_maps import HeatMap, draw_heat_maps
from hlp.reporting.mlflow.pages import headline_metrics
from hlp.reporting.mlflow.run import MlflowRun
from hlp.reporting.study_numbers import ADD, KINDS, RUN, Number
from hlp.reporting.sweeps import Sweep, SweepRun, say_difference, short_key
from hlp.reporting.table import Table, format_interval, lay_out, prose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LONGEST = 24  # characters of a value in a table
_BEST = "* best by {}; of ties the default, if it is one of them."
_PAIRED = (
    "Differences are over the targets of both runs (of times: between their medians), with the 95 %"
    " interval of the paired bootstrap over blocks of neighbouring frames."
)


def sweep_table(sweep: Sweep, *, whole: bool = True) -> Table:
    """A row a run: its values and numbers; the best run has a `*`.

    The difference to the reference, with its interval, follows if runs are compared by one number;
    of several see `differences_table`. `whole`: also what does not fit a terminal.
    """
    loads = {run.numbers["load"].text for run in sweep.finished if "load" in run.numbers}
    left_out = set() if whole else {n for n, number in sweep.numbers.items() if number.more}
    left_out |= {"load"} if sweep.name == RUN and not whole and len(loads) < 2 else set()
    names = [name for name in sweep.numbers if name not in left_out] or [ADD]
    with_interval = {
        name
        for run in sweep.finished
        for name, number in run.numbers.items()
        if number.interval is not None and (whole or number.main)
    }
    compared = sweep.mains if len(sweep.mains) == 1 else []
    header = [*_keys(sweep, whole)]
    for name in names:
        header += [name, "95 %"] if name in with_interval else [name]
    for _ in compared:
        header += [f"to {sweep.against}", "95 % of it"]
    rows = []
    for run in sweep.runs:
        row = _values(sweep, run, whole)
        for name in names:
            number = run.numbers.get(name)
            row.append(number.text if number else "")
            if name in with_interval:
                ends = number.interval if number else None
                row.append("" if ends is None else format_interval(ends))
        for name in compared:
            row += _difference_cells(sweep, run, name)
        if not run.numbers:
            row[header.index(sweep.first_main or names[0])] = "no result"
        rows.append(row)
    return Table(header, rows)


def _keys(sweep: Sweep, whole: bool) -> list[str]:
    """Column names of the swept keys: one each or, for a terminal, one for all."""
    names = [short_key(key) for key in sweep.keys] or ["run"]
    return names if whole else [", ".join(names)]


def _values(sweep: Sweep, run: SweepRun, whole: bool) -> list[str]:
    values = [run.values.get(key, "") for key in sweep.keys] or [run.folder.name]
    values = [v if len(v) <= _LONGEST else f"{v[: _LONGEST - 1]}…" for v in values]
    values = values if whole else [", ".join(values)]
    return [*values[:-1], f"{values[-1]} *" if run is sweep.best else values[-1]]


def _difference_cells(sweep: Sweep, run: SweepRun, name: str) -> list[str]:
    if not run.numbers:
        return ["", ""]
    if run is sweep.reference:
        return [sweep.against, ""]
    found = sweep.difference(run, name)
    return ["–", ""] if found is None else say_difference(sweep.numbers[name], found)


def differences_table(sweep: Sweep, *, whole: bool = True) -> Table | None:
    """A row a finished run: the main numbers' paired differences to the reference.

    With 95 % intervals. None for a single number, and where nothing can be compared.
    """
    names = [name for name in sweep.mains if name in sweep.differences]
    if not names or len(sweep.mains) == 1:
        return None
    rows = []
    for run in sweep.finished:
        cells = [_difference_cells(sweep, run, name) for name in names]
        joined = [f"{words} ({interval})" if interval else words for words, interval in cells]
        rows.append([*_values(sweep, run, whole), *joined])
    return Table([*_keys(sweep, whole), *(f"{name} to {sweep.against}" for name in names)], rows)


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
    tables = [sweep_table(sweep, whole=whole), differences_table(sweep, whole=whole)]
    shown = [table if whole else table.fitted(0) for table in tables if table is not None]
    laid_out = [lay_out(table, layout) for table in shown]
    note, verdict = (prose(words, layout) for words in (note_of(sweep), sweep.verdict))
    return "\n\n".join([verdict, *laid_out, note] if whole else [*laid_out, note, verdict])


def write_sweep(folder: Path, sweep: Sweep) -> list[Path]:
    """Write NAME.md, NAME.csv and, if a run has finished, NAME.png and NAME.svg; those files.

    NAME is `sweep`, or that of the study, whose CSV has the differences of all numbers. Of plain
    runs also what `draw_trade_off` draws.
    """
    markdown, rows = folder / f"{sweep.name}.md", folder / f"{sweep.name}.csv"
    described = describe_sweep(sweep, "markdown")
    write_text(markdown, f"{described}\n\nMade by `{sweep.command}`.\n")
    if sweep.name == RUN:
        table = sweep_table(sweep)
        write_csv(rows, table.header, table.rows)
    else:
        _write_numbers(rows, sweep)
    figure = sweep_figure(sweep)
    drawn = save_figure(figure, folder / sweep.name) if figure else []
    return [markdown, rows, *drawn, *draw_trade_off(folder, sweep.results, sweep.keys)]


def _write_numbers(path: Path, sweep: Sweep) -> None:
    """All numbers of studies: each with its interval, and its difference with that interval."""
    rows = []
    for run in sweep.runs:
        row: dict[str, float | str] = {key: run.values.get(key, "") for key in sweep.keys}
        for name in sweep.numbers:
            number, difference = run.numbers.get(name), sweep.difference(run, name)
            row |= _with_ends(name, (number.value, number.interval) if number else None)
            row |= _with_ends(f"{name} difference", difference)
        rows.append(row)
    columns = [
        name for name in rows[0] if name in sweep.keys or any(row[name] != "" for row in rows)
    ]
    write_csv(path, columns, [[row[name] for name in columns] for row in rows])


def _with_ends(
    name: str, found: tuple[float, tuple[float, float] | None] | None
) -> dict[str, float | str]:
    """Cells of a number and of the ends of its interval, by column."""
    value, ends = ("", None) if found is None else found
    low, high = ends or ("", "")
    return {name: value, f"{name} 95 % low": low, f"{name} 95 % high": high}


def sweep_figure(sweep: Sweep) -> "Figure | None":
    """Heat maps for two keys, bars otherwise; None without any result."""
    if not sweep.finished:
        return None
    complete = all(key in run.values for key in sweep.keys for run in sweep.finished)
    if sweep.name == RUN and len(sweep.keys) == 2 and complete:
        return _grid(sweep)
    rows = [f"{run.short_label}{' *' * (run is sweep.best)}" for run in sweep.finished]
    panels = _number_panels([run.numbers for run in sweep.finished])
    if sweep.name == RUN:
        panels = run_panels([result.summary for result in sweep.results])
        name = sweep.first_main
        bars = [gain_bar(sweep.difference(run, name)) for run in sweep.finished]
        if any(bars):
            panels.insert(1, Panel(f"{name} recall minus that of the {sweep.against}", {"": bars}))
    marked = [row for row, run in enumerate(sweep.finished) if run is sweep.reference]
    return draw_bars(rows, panels, _title(sweep), marked=marked if sweep.is_default else ())


def _number_panels(runs: Sequence[Mapping[str, Number]]) -> list[Panel]:
    """A panel for each kind of number of studies."""
    named: dict[str, dict[str, Number]] = {}
    for numbers in runs:
        for name, number in numbers.items():
            if number.panel:
                named.setdefault(number.panel, {})[name] = number
    panels = []
    for title, found in named.items():
        series = {
            name: [
                Bar(numbers[name].value, numbers[name].text, numbers[name].interval)
                if name in numbers
                else None
                for numbers in runs
            ]
            for name in found
        }
        recall = all(number.quantity == "recall" for number in found.values())
        panels.append(Panel(title, series, recall))
    return panels


def _grid(sweep: Sweep) -> "Figure":
    """Recall left and time right, a cell for each pair of values."""
    pairs = [tuple(run.values[key] for key in sweep.keys) for run in sweep.finished]
    across, down = (list(dict.fromkeys(pair[place] for pair in pairs)) for place in (0, 1))
    recalls, times = (np.full((len(down), len(across)), np.nan) for _ in range(2))
    for (x, y), result in zip(pairs, sweep.results, strict=True):
        place = down.index(y), across.index(x)
        recalls[place], times[place] = result.add["recall"], result.total_ms["median"]
    maps = [
        HeatMap("ADD(-S) recall", recalls),
        HeatMap("ms, median", times, "{:.0f}".format, "viridis_r"),
    ]
    default = sweep.reference if sweep.is_default else None
    values = None if default is None else [default.values[key] for key in sweep.keys]
    marked = None if values is None else (down.index(values[1]), across.index(values[0]))
    return draw_heat_maps(maps, down, across, (sweep.keys[0], sweep.keys[1]), _title(sweep), marked)


def _title(sweep: Sweep) -> str:
    if sweep.name != RUN:
        return sweep.verdict
    results = sweep.results
    names = ", ".join(map(short_key, sweep.keys)) or "runs"
    targets = {result.targets for result in results}
    counted = f", {targets.pop()} targets" if len(targets) == 1 else ""
    return f"{names}: {len(results)} runs of {results[0].experiment}{counted}"


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
