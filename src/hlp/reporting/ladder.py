"""The steps of `experiment=ladder`: what each changes, and what it gains."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hlp.reporting.comparison import (
    WELL_VISIBLE,
    Difference,
    difference_cells,
    paired_difference,
    recall_of,
)
from hlp.reporting.figures.bars import Bar, Panel, draw_bars, recall_bar
from hlp.reporting.paper_reports import measured_on
from hlp.reporting.results import Result
from hlp.reporting.tables.summary_tables import result_cells, run_cells
from hlp.reporting.tables.table import Table, result_difference, result_share

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LADDER = "ladder"
"""Name of the experiment, of the config group that it sweeps, and of the files of its table."""
LADDER_NOTE = (
    "Each step differs by one decision from that under *against*; what it gains is over the"
    " targets of both, with the 95 % interval of the paired bootstrap over blocks of neighbouring"
    " frames. AR: BOP's average recall. ms: median for one object in one frame."
)


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
    verdicts = {name: result.verdicts for name, result in runs.items()}
    steps = []
    for name, result in runs.items():
        given: Mapping[str, str | None] = result.config["arm"]
        before = given["before"] or ""
        gain = paired_difference(verdicts.get(before, {}), verdicts[name], "verdict")
        other = runs.get(before, result).total_ms["median"]
        spent = result.total_ms["median"] - other
        steps.append(LadderStep(name, given["change"] or "", before, result, gain, spent))
    return steps


def ladder_tables(steps: Sequence[LadderStep]) -> tuple[Table, Table]:
    """A row a step: recalls, and what it gained; the second table fits a terminal."""
    against = ["against", "ADD(-S) gained", "95 % of it", "ms more"]
    shown = ["ADD(-S)", "95 %", "5cm5deg", "IoU.5", "AR", "ms"]
    rows = []
    for step in steps:
        cells, gained = run_cells(step.result.summary), ["–"] * len(against)
        if step.gain is not None:
            gained = [step.before, *difference_cells(step.gain), f"{step.milliseconds:+.0f}"]
        rows.append([step.name, step.change, *(cells[name] for name in shown), *gained])
    table = Table(["arm", "change", *(name.removesuffix(".5") for name in shown), *against], rows)
    narrow = table.without("change", "95 %", "5cm5deg", "IoU", "AR")
    names = [name.removeprefix("ADD(-S) ") for name in narrow.header]
    return table, Table(names, narrow.rows).fitted(0, names.index("against"))


def step_figures(steps: Sequence[LadderStep]) -> Table:
    """Recalls of each step, also of the targets that are mostly hidden, and its gain."""
    shown = ["add", "add_low", "add_high", "5cm5deg", "iou50", "ar"]
    rows = []
    for step in steps:
        cells, hidden = result_cells(step.result.summary), step.result.hidden_targets
        recalls = [cells[name] for name in shown]
        recalls.append(result_share(recall_of(hidden, "add") if hidden else None))
        before = step.before if step.gain else ""
        rows.append([step.name, step.change, *recalls, before, *result_difference(step.gain)])
    gained = ["from", "gain", "gain_low", "gain_high"]
    return Table(["step", "change", *shown, f"visible_below_{WELL_VISIBLE:g}", *gained], rows)


def draw_ladder(steps: Sequence[LadderStep]) -> "Figure":
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
