"""The table and the figure that every sweep ends with."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.files import write_csv, write_text
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.swarm_costs import Step, draw_steps
from hlp.reporting.figures.sweep_grid import draw_grid
from hlp.reporting.figures.sweep_panels import SweepFigure, SweepPoint, draw_sweep
from hlp.reporting.results import read_results
from hlp.reporting.sweep_arms import Sweep, short_key, sweep_of, sweep_table, sweep_verdict
from hlp.reporting.tables.table import LAYOUTS, TERMINAL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "sweep"
"""The files that table and figure are written to."""
_MOST_VALUES = 10  # beside each other in panels; more are drawn below each other
_NOTE = (
    "* the highest ADD(-S) recall; the default, if none is surely higher. Differences are over the"
    " targets of both arms, with the 95 % interval of the paired bootstrap over blocks of"
    " neighbouring frames. AR: BOP's average recall; ms: median for one object in one frame;"
    " CPU ms: mean CPU time of all threads for it; load: of the machine in the minute before."
)


def describe_sweep(folder: Path, layout: str) -> str:
    """The arms of a sweep for people: what came out in a sentence, and a table; empty for studies.

    `layout` is `text`, then the table fits a terminal if the values do, or `markdown`. A terminal
    shows the end first, a page the beginning: the sentence stands there.
    """
    sweep = sweep_of(read_results(folder))
    if not sweep.arms:
        return ""
    table = sweep_table(sweep, whole=layout != "text")
    if layout == "text":
        table = table.fitted(*range(max(1, len(sweep.keys))))
    words, rows = sweep_verdict(sweep), LAYOUTS[layout](table)
    if layout == "text":
        return f"{rows}\n\n{textwrap.fill(words, TERMINAL)}"
    return f"{words}\n\n{rows}"


def write_sweep_files(folder: Path) -> list[Path]:
    """Write sweep.md, sweep.csv and, if an arm has finished, sweep.png and .svg; those files.

    None for a sweep of studies such as `hlp bench`, which have no recall.
    """
    sweep = sweep_of(read_results(folder))
    if not sweep.arms:
        return []
    table = sweep_table(sweep)
    markdown, rows = folder / f"{NAME}.md", folder / f"{NAME}.csv"
    made = f"Made by `{sweep.command}`."
    write_text(markdown, "\n\n".join([sweep_verdict(sweep), table.markdown(), _NOTE, made]) + "\n")
    write_csv(rows, table.header, table.rows)
    figure = sweep_figure(sweep)
    return [markdown, rows, *(save_figure(figure, folder / NAME) if figure else [])]


def sweep_figure(sweep: Sweep) -> "Figure | None":
    """Panels for one key, heat maps for two, a row an arm for more; None without any result."""
    if not sweep.finished:
        return None
    keys, values = sweep.keys, [arm.values for arm, _ in sweep.finished]
    complete = all(key in each for key in keys for each in values)
    if len(keys) == 1 and complete and len(values) <= _MOST_VALUES:
        return _panels(sweep)
    if len(keys) == 2 and complete:
        return _grid(sweep)
    steps = []
    for arm, result in sweep.finished:
        ends = result.add["ci95"]
        recall = (float(result.add["recall"]), (float(ends[0]), float(ends[1])))
        steps.append(Step(arm.label, recall, sweep.difference(arm)))
    return draw_steps(steps, _title(sweep))


def _panels(sweep: Sweep) -> "Figure":
    key = sweep.keys[0]
    points = [SweepPoint.of(arm.values[key], result.summary) for arm, result in sweep.finished]
    default = [sweep.reference.values[key]] if sweep.is_default and sweep.reference else []
    words = SweepFigure(_title(sweep), key, default, "default")
    return draw_sweep(words, {"": points})


def _grid(sweep: Sweep) -> "Figure":
    first, second = sweep.keys
    cells = {
        (arm.values[first], arm.values[second]): (
            float(result.add["recall"]),
            float(result.total_ms["median"]),
        )
        for arm, result in sweep.finished
    }
    default = sweep.reference.values if sweep.is_default and sweep.reference else {}
    marked = (default[first], default[second]) if default else None
    return draw_grid(cells, (first, second), marked, _title(sweep))


def _title(sweep: Sweep) -> str:
    results = [result for _, result in sweep.finished]
    names = ", ".join(short_key(key) for key in sweep.keys) or "runs"
    targets = {result.targets for result in results}
    counted = f", {targets.pop()} targets" if len(targets) == 1 else ""
    return f"{names}: {len(results)} arms of {results[0].experiment}{counted}"
