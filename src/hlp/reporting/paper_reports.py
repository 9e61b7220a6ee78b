"""The paper's Fig. 9, its Tables 1 and 2, and swarm against ICP: its numbers beside ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, Any

from hlp.reporting import paper_results
from hlp.reporting.figures.bars import Bar, Panel, draw_bars, run_panels
from hlp.reporting.paper_results import ADD_MEAN, ADD_STD, MS_PER_FRAME
from hlp.reporting.results import Result
from hlp.reporting.tables.summary_tables import METRIC_LABELS, run_cells
from hlp.reporting.tables.table import Table, format_interval, format_share

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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

Series = Mapping[str, Sequence[Result]]
"""Runs by the other swept settings in words (empty if there are none)."""


def trend_note(trend: Trend) -> str:
    """The caption: what the paper's points are."""
    return (
        f"{trend.note} Beside ours is the paper's result with its own setting,"
        f" {trend.paper_values[0]}: mean ADD(-S) {ADD_MEAN:.3f} on LINEMOD's whole sequences"
        f" (Table 1), about {MS_PER_FRAME:.0f} ms a frame (i7, GTX 970M)."
    )


def trend_table(trend: Trend, series: Series) -> Table:
    """A row for each run: recalls, the 95 % interval of ADD(-S), times, and the paper's numbers.

    The paper's numbers stand in the row of the setting that it chose.
    """
    several = [""] if len(series) > 1 else []
    add, *others = METRIC_LABELS.values()
    ours = ["targets", add, "95 %", *others, "ms refinement", "ms", "ms 95 %"]
    rows = []
    for name, result in _each(series):
        value, cells = trend.value(result), run_cells(result.summary)
        chosen = value in trend.paper_values
        paper = [f"{ADD_MEAN:.3f}", f"{MS_PER_FRAME:.0f}"] if chosen else ["", ""]
        rows.append([value, *(name for _ in several), *(cells[column] for column in ours), *paper])
    return Table([trend.axis, *several, *ours, "paper ADD(-S)", "paper ms"], rows)


def _each(series: Series) -> list[tuple[str, Result]]:
    return [(name, result) for name, results in series.items() for result in results]


def draw_trend(trend: Trend, series: Series, data: str) -> "Figure":
    """ADD(-S) and 5cm5deg recall with 95 % intervals, and the times of the stages.

    `data` says in words what was measured on. The paper's choice is marked, its recall a point.
    """
    runs = _each(series)
    values = [trend.value(result) for _, result in runs]
    chosen = [row for row, value in enumerate(values) if value in trend.paper_values]
    add, *others = run_panels([result.summary for _, result in runs])
    if chosen:
        points = [ADD_MEAN if row in chosen else None for row in range(len(runs))]
        add = replace(add, published={"paper, Table 1": points})
    rows = [
        ", ".join(filter(None, (value, name))) + " (paper's choice)" * (row in chosen)
        for row, (value, (name, _)) in enumerate(zip(values, runs, strict=True))
    ]
    title = f"{trend.title}, {trend.axis}: {data}"
    return draw_bars(rows, [add, *others], title, trend_note(trend), chosen)


TABLES = {"table1": "Table 1: ADD(-S) recall", "table2": "Table 2: recall"}
"""Titles of the tables by the name of their experiment."""
OBJECTS_NOTE = (
    "Paper: Table 1, LINEMOD's whole sequences (left out if any object is not one of LINEMOD's);"
    f" its mean of 15 objects is {ADD_MEAN:.3f}, its standard deviation {ADD_STD:.3f}. Ours: with"
    " the 95 % interval of the bootstrap over blocks of neighbouring frames; where all are right or"
    " none, Wilson's."
)
METRICS_NOTE = (
    "Paper, and Brachmann et al. as it quotes them: Table 2, the Occlusion set. Ours: recall over"
    " all targets, with the 95 % interval of the bootstrap over blocks of neighbouring frames."
)
Runs = Mapping[str, Result]
"""Results by the run's label."""


@dataclass(frozen=True)
class RecallColumn:
    """A column of recalls, one for each row of the table; None where a column has no number.

    `intervals` (95 %) is empty for published numbers, which come without.
    """

    label: str
    recalls: list[float | None]
    intervals: list[tuple[float, float] | None]

    def cells(self) -> dict[str, list[str]]:
        """The cells of each row by column: the recalls and, of our own, the intervals."""
        cells = {self.label: [format_share(recall) for recall in self.recalls]}
        if self.intervals:
            cells["95 %"] = [format_interval(ends) if ends else "" for ends in self.intervals]
        return cells


def objects_of(runs: Runs) -> list[str]:
    """Names of all objects that any of the runs looked for, in order."""
    return list(dict.fromkeys(name for run in runs.values() for name in run.summary["per_object"]))


def object_columns(runs: Runs) -> list[RecallColumn]:
    """Columns of Table 1: ADD(-S) recall per object, the paper's first if all are LINEMOD's."""
    names, known = objects_of(runs), paper_results.ADD_BY_OBJECT
    linemod = all(name in known for name in names)
    columns = [RecallColumn("paper", [known[name] for name in names], [])] if linemod else []
    for label, run in runs.items():
        scores = [run.summary["per_object"].get(name, {}).get("add", {}) for name in names]
        recalls = [score.get("recall") for score in scores]
        ends = [score.get("ci95") for score in scores]  # older runs have none
        columns.append(RecallColumn(label, recalls, ends))
    return columns


def metric_columns(runs: Runs) -> list[RecallColumn]:
    """Columns of Table 2: recall over all targets by each metric, the paper's first."""
    printed = {
        "paper": paper_results.OCCLUSION,
        "Brachmann et al.": paper_results.OCCLUSION_BRACHMANN,
    }
    columns = [
        RecallColumn(label, [recalls[key] for key in METRIC_LABELS], [])
        for label, recalls in printed.items()
    ]
    for label, run in runs.items():
        scores = [run.summary["metrics"][key] for key in METRIC_LABELS]
        recalls = [score["recall"] for score in scores]
        columns.append(RecallColumn(label, recalls, [score["ci95"] for score in scores]))
    return columns


def object_recalls_table(runs: Runs) -> Table:
    """Table 1: a row an object, then mean and standard deviation of the objects, all targets."""
    names, columns = objects_of(runs), object_columns(runs)
    first = next(iter(runs.values())).summary
    asked = [str(first["per_object"].get(name, {}).get("targets", "")) for name in names]
    table = _recalls_table({"object": names, "targets": asked}, columns)
    rows = [*table.rows]
    for title, statistic in (("mean of objects", fmean), ("standard deviation", pstdev)):
        row = [title, ""]
        for column in columns:
            known = [recall for recall in column.recalls if recall is not None]
            row += [format_share(statistic(known)), *([""] if column.intervals else [])]
        rows.append(row)
    total = [
        "all targets",
        str(first["targets"]),
        *("" for column in columns if not column.intervals),
    ]
    for run in runs.values():
        total += [format_share(run.add["recall"]), format_interval(run.add["ci95"])]
    return Table(table.header, [*rows, total])


def metric_recalls_table(runs: Runs) -> Table:
    """Table 2: a row a metric."""
    return _recalls_table({"recall": [*METRIC_LABELS.values()]}, metric_columns(runs))


def _recalls_table(first: Mapping[str, Sequence[str]], columns: Sequence[RecallColumn]) -> Table:
    cells = [*first.items(), *(pair for column in columns for pair in column.cells().items())]
    header, by_column = zip(*cells, strict=True)
    return Table(header, [list(row) for row in zip(*by_column, strict=True)])


def draw_recalls(
    rows: Sequence[str], columns: Sequence[RecallColumn], title: str, note: str
) -> "Figure":
    """A bar with its 95 % interval for each row and column of ours; points are others' numbers."""
    measured: dict[str, list[Bar | None]] = {
        column.label: [
            None if recall is None else Bar(recall, format_share(recall), ends)
            for recall, ends in zip(column.recalls, column.intervals, strict=True)
        ]
        for column in columns
        if column.intervals
    }
    published = {column.label: column.recalls for column in columns if not column.intervals}
    return draw_bars(rows, [Panel("recall", measured, published=published)], title, note)


def measured_on(result: Result) -> str:
    """What a run was measured on, in words."""
    data: Mapping[str, Any] = result.config["data"]
    root = Path(str(data["root"])).name if data.get("root") else ""
    where = f"{root} ({data['name']})" if root else f"{data['name']} data"
    return f"{result.targets} targets in {result.frames} frames of {where}"
