"""The paper's Fig. 9, its Tables 1 and 2, and swarm against ICP: its numbers beside ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, Any

from hlp.reporting.comparison import paired_difference, with_ends
from hlp.reporting.figures.bars import Panel, draw_bars, recall_bar, run_panels
from hlp.reporting.results import Result
from hlp.reporting.summary_tables import (
    ADD_CELLS,
    ADD_MEAN,
    ADD_STD,
    METRIC_LABELS,
    MS_PER_FRAME,
    paper_recalls,
    run_cells,
)
from hlp.reporting.table import Table, format_interval, format_share

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OCCLUSION = {
    "paper": {"add": 0.632, "5cm5deg": 0.362, "iou50": 0.799},
    "Brachmann et al.": {"add": 0.566, "5cm5deg": 0.227, "iou50": 0.620},
}
"""Recall on the Occlusion set as the paper's Table 2 prints it, by the keys of `summary.json`."""


@dataclass(frozen=True)
class Trend:
    """A figure of recall and time against one setting.

    `keys` are the configuration keys that change along the axis, `form` is how a run's values of
    them are written. `paper_values` are those that the paper chose. `note` says how far the figure
    can be compared with the paper.
    """

    title: str
    axis: str
    keys: tuple[str, ...]
    paper_values: tuple[str, ...]
    form: str = "{}"
    note: str = "The paper's text gives no values for this figure: compare the trends, not numbers."

    def value(self, result: Result) -> str:
        """A run's value on the axis; of a config group, the name of its file."""
        values = []
        for key in self.keys:
            group, _, name = key.partition(".")
            given = result.config[group][name or "name"]
            values.append(given if name else result.chosen.get(key, given))
        return self.form.format(*values)

    def is_papers(self, result: Result) -> bool:
        """Whether a run has the value that the paper chose."""
        return self.value(result) in self.paper_values


_BOX = ("refinement.theta_deg", "refinement.tau_mm")
TRENDS = {
    "fig9a": Trend("Fig. 9a", "length of the local feature", ("encoder.dimension",), ("200",)),
    "fig9b": Trend("Fig. 9b", "particles N", ("refinement.particles",), ("25",)),
    "fig9c": Trend(
        "Fig. 9c", "box of the search {θ, τ}", _BOX, ("{5°, 5 mm}",), "{{{:g}°, {:g} mm}}"
    ),
    "pso_vs_icp": Trend(
        "PSO against ICP",
        "refinement",
        ("refinement",),
        ("pso", "paper"),
        note="The paper discusses it in words.",
    ),
}
"""The figures by the name of their experiment."""

Runs = Sequence[tuple[str, Result]]
"""Runs with their further swept settings in words (empty if there are none)."""


def trend_note(trend: Trend) -> str:
    """The caption: what the paper's points are."""
    return (
        f"{trend.note} Beside ours is the paper's result with its own setting,"
        f" {trend.paper_values[0]}: mean ADD(-S) {ADD_MEAN:.3f} on LINEMOD's whole sequences"
        f" (Table 1), about {MS_PER_FRAME:.0f} ms a frame (i7, GTX 970M)."
    )


def trend_tables(trend: Trend, runs: Runs) -> tuple[Table, Table]:
    """A row for each run: recalls, times, and the paper's numbers; and what figures.csv holds.

    The paper's numbers stand in the row of the setting that it chose. figures.csv has the paired
    differences to that row.
    """
    several = [""] if len({words for words, _ in runs}) > 1 else []
    add, *others = METRIC_LABELS.values()
    ours = ["targets", add, "95 %", "ms", "load", *others, "ms 95 %", "ms refinement"]
    shown = {**ADD_CELLS, "5cm5deg": "5cm5deg", "ar": "AR"}
    papers = {words: result for words, result in runs if trend.is_papers(result)}
    rows, figures = [], []
    for words, result in runs:
        cells, value, before = run_cells(result.summary), trend.value(result), papers.get(words)
        paper = [f"{ADD_MEAN:.3f}", f"{MS_PER_FRAME:.0f}"]
        paper = paper if trend.is_papers(result) else ["", ""]
        named = [value, *(words for _ in several)]
        rows.append([*named, *(cells[column] for column in ours), *paper])
        found = None
        if before is not None and before is not result:
            found = paired_difference(before.verdicts, result.verdicts)
        setting = ", ".join(filter(None, (*trend.keys, words)))
        named = [trend.title.removeprefix("Fig. "), setting, value]
        figures.append([*named, *(cells[column] for column in shown.values()), *with_ends(found)])
    differences = ["difference", "difference_low", "difference_high"]
    return (
        Table([trend.axis, *several, *ours, "paper ADD(-S)", "paper ms"], rows),
        Table(["figure", "setting", "value", *shown, *differences], figures),
    )


def draw_trend(trend: Trend, runs: Runs, data: str) -> "Figure":
    """ADD(-S) and 5cm5deg recall with 95 % intervals, and the times of the stages.

    `data` says in words what was measured on. The paper's choice is marked, its recall a point.
    """
    chosen = [row for row, (_, result) in enumerate(runs) if trend.is_papers(result)]
    add, *others = run_panels([result.summary for _, result in runs])
    if chosen:
        points = [ADD_MEAN if row in chosen else None for row in range(len(runs))]
        add = replace(add, published={"paper, Table 1": points})
    rows = [
        ", ".join(filter(None, (trend.value(result), words)))
        + " (paper's choice)" * (row in chosen)
        for row, (words, result) in enumerate(runs)
    ]
    title = f"{trend.title}, {trend.axis}: {data}"
    return draw_bars(rows, [add, *others], title, trend_note(trend), chosen)


TABLES = {"table1": "Table 1: ADD(-S) recall", "table2": "Table 2: recall"}
"""Titles of the tables by the name of their experiment."""
NOTES = {
    "table1": "Paper: Table 1, LINEMOD's whole sequences (left out if any object is not one of"
    f" LINEMOD's); its mean of 15 objects is {ADD_MEAN:.3f}, its standard deviation {ADD_STD:.3f}."
    " Ours: with the 95 % interval of the bootstrap over blocks of neighbouring frames; where all"
    " are right or none, Wilson's.",
    "table2": "Paper, and Brachmann et al. as it quotes them: Table 2, the Occlusion set. Ours:"
    " recall over all targets, with the 95 % interval of the bootstrap over blocks of neighbouring"
    " frames.",
}


@dataclass(frozen=True)
class Recalls:
    """Recalls row by row: those printed in papers, and ours by the run's label.

    Ours are metrics of `summary.json`, empty where a run was not asked.
    """

    rows: Sequence[str]
    printed: Mapping[str, Sequence[float]]
    ours: Mapping[str, Sequence[Mapping[str, Any]]]

    def table(self, head: str) -> Table:
        """A column for each series, and the 95 % interval behind each of ours."""
        names = [name for label in self.ours for name in (label, "95 %")]
        rows = []
        for row, name in enumerate(self.rows):
            cells = [format_share(recalls[row]) for recalls in self.printed.values()]
            for scores in self.ours.values():
                cells += [format_share(scores[row].get("recall"))]
                cells += [format_interval(scores[row].get("ci95", ()))]
            rows.append([name, *cells])
        return Table([head, *self.printed, *names], rows)

    def figure(self, title: str, note: str) -> "Figure":
        """A bar with its interval for each of ours; printed recalls are points."""
        measured = {
            label: [recall_bar(score) if score else None for score in scores]
            for label, scores in self.ours.items()
        }
        panel = Panel("recall", measured, published=self.printed)
        return draw_bars(self.rows, [panel], title, note)


def object_recalls(runs: Mapping[str, Result]) -> Recalls:
    """Of Table 1: ADD(-S) recall per object, the paper's too if all objects are LINEMOD's."""
    objects = {label: run.summary["per_object"] for label, run in runs.items()}
    names = [*dict.fromkeys(name for own in objects.values() for name in own)]
    paper = paper_recalls(names)
    printed = {"paper": paper} if paper else {}
    ours = {
        label: [own.get(name, {}).get("add", {}) for name in names]
        for label, own in objects.items()
    }
    return Recalls(names, printed, ours)


def object_recalls_table(runs: Mapping[str, Result]) -> Table:
    """Table 1: a row an object, then mean and standard deviation of the objects, all targets."""
    found, first = object_recalls(runs), next(iter(runs.values())).summary
    table = found.table("object")
    asked = [str(first["per_object"].get(name, {}).get("targets", "")) for name in found.rows]
    rows = [[row[0], count, *row[1:]] for row, count in zip(table.rows, asked, strict=True)]
    for title, statistic in (("mean of objects", fmean), ("standard deviation", pstdev)):
        row = [title, "", *(f"{statistic(recalls):.3f}" for recalls in found.printed.values())]
        for scores in found.ours.values():
            row += [f"{statistic(score['recall'] for score in scores if score):.3f}", ""]
        rows.append(row)
    total = ["all targets", str(first["targets"]), *("" for _ in found.printed)]
    for run in runs.values():
        total += [format_share(run.add["recall"]), format_interval(run.add["ci95"])]
    return Table([table.header[0], "targets", *table.header[1:]], [*rows, total])


def metric_recalls(runs: Mapping[str, Result]) -> Recalls:
    """Of Table 2: recall over all targets by each metric, the printed ones first."""
    printed = {label: [own[key] for key in METRIC_LABELS] for label, own in OCCLUSION.items()}
    metrics = {label: run.summary["metrics"] for label, run in runs.items()}
    ours = {label: [own[key] for key in METRIC_LABELS] for label, own in metrics.items()}
    return Recalls([*METRIC_LABELS.values()], printed, ours)


def measured_on(result: Result) -> str:
    """What a run was measured on, in words."""
    data: Mapping[str, Any] = result.config["data"]
    root = Path(str(data["root"])).name if data.get("root") else ""
    where = f"{root} ({data['name']})" if root else f"{data['name']} data"
    return f"{result.targets} targets in {result.frames} frames of {where}"
