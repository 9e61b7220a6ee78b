"""The paper's Tables 1 and 2 with its numbers beside ours."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, pstdev

from hlp.reporting import paper_results
from hlp.reporting.results import Result
from hlp.reporting.tables.summary_tables import METRIC_LABELS
from hlp.reporting.tables.table import Table, format_interval, format_share

OBJECTS_NOTE = (
    "Paper: Table 1, LINEMOD's whole sequences (left out if any object is not one of LINEMOD's);"
    f" its mean of 15 objects is {paper_results.ADD_MEAN:.3f}, its standard deviation"
    f" {paper_results.ADD_STD:.3f}. Ours: with the 95 % interval of the bootstrap over blocks"
    " of neighbouring frames; where all are right or none, Wilson's."
)
METRICS_NOTE = (
    "Paper, and Brachmann et al. as it quotes them: Table 2, the Occlusion set. Ours: recall over"
    " all targets, with the 95 % interval of the bootstrap over blocks of neighbouring frames."
)


@dataclass(frozen=True)
class RecallColumn:
    """A column of recalls, one for each row of the table; None where a column has no number.

    `intervals` (95 %) is empty for published numbers, which come without.
    """

    label: str
    recalls: list[float | None]
    intervals: list[tuple[float, float] | None]

    @property
    def measured(self) -> bool:
        """Whether these are our own measurements."""
        return bool(self.intervals)


Runs = Mapping[str, Result]


def objects_of(runs: Runs) -> list[str]:
    """Names of all objects that any of the runs looked for, in order."""
    return list(dict.fromkeys(name for run in runs.values() for name in run.summary["per_object"]))


def object_columns(runs: Runs) -> list[RecallColumn]:
    """Columns of Table 1: ADD(-S) recall per object, the paper's first if all are LINEMOD's.

    `runs` maps each run's label to its result.
    """
    names, known = objects_of(runs), paper_results.ADD_BY_OBJECT
    linemod = all(name in known for name in names)
    columns = [RecallColumn("paper", [known[name] for name in names], [])] if linemod else []
    for label, run in runs.items():
        scores = [run.summary["per_object"].get(name) for name in names]
        recalls = [each and each["add"]["recall"] for each in scores]
        ends = [each and each["add"].get("ci95") for each in scores]  # older runs have none
        columns.append(RecallColumn(label, recalls, ends))
    return columns


def metric_columns(runs: Runs) -> list[RecallColumn]:
    """Columns of Table 2: recall over all targets by each metric, the paper's first."""
    columns = [
        RecallColumn(label, [recalls[key] for key in METRIC_LABELS], [])
        for label, recalls in (
            ("paper", paper_results.OCCLUSION),
            ("Brachmann et al.", paper_results.OCCLUSION_BRACHMANN),
        )
    ]
    for label, run in runs.items():
        scores = [run.summary["metrics"][key] for key in METRIC_LABELS]
        ends = [(each["ci95"][0], each["ci95"][1]) for each in scores]
        columns.append(RecallColumn(label, [each["recall"] for each in scores], [*ends]))
    return columns


def object_recalls_table(runs: Runs) -> Table:
    """Table 1: a row an object, then mean and standard deviation of the objects, all targets."""
    names, columns = objects_of(runs), object_columns(runs)
    rows = _rows(names, columns)
    rows.append(["mean of objects", *_statistic_row(columns, fmean)])
    rows.append(["standard deviation", *_statistic_row(columns, pstdev)])
    total = ["all targets", *("" for each in columns if not each.measured)]
    for run in runs.values():
        add = run.summary["metrics"]["add"]
        total += [format_share(add["recall"]), format_interval(add["ci95"])]
    first = next(iter(runs.values())).summary
    asked = [str(first["per_object"].get(name, {}).get("targets", "")) for name in names]
    counts = [*asked, "", "", str(first["targets"])]
    counted = [[row[0], n, *row[1:]] for row, n in zip([*rows, total], counts, strict=True)]
    return Table(["object", "targets", *_header(columns)], counted)


def metric_recalls_table(runs: Runs) -> Table:
    """Table 2: a row a metric."""
    columns = metric_columns(runs)
    return Table(["recall", *_header(columns)], _rows([*METRIC_LABELS.values()], columns))


def _header(columns: Sequence[RecallColumn]) -> list[str]:
    return [cell for each in columns for cell in (each.label, *["95 %"] * each.measured)]


def _rows(names: Sequence[str], columns: Sequence[RecallColumn]) -> list[list[str]]:
    rows = [[name] for name in names]
    for column in columns:
        for i, row in enumerate(rows):
            row.append(format_share(column.recalls[i]))
            if column.measured:
                ends = column.intervals[i]
                row.append("" if ends is None else format_interval(ends))
    return rows


def _statistic_row(
    columns: Sequence[RecallColumn], statistic: Callable[[Sequence[float]], float]
) -> list[str]:
    cells = []
    for column in columns:
        known = [recall for recall in column.recalls if recall is not None]
        cells += [format_share(statistic(known)), *[""] * column.measured]
    return cells
