"""The oracle matrix as a table, as CSV, and as numbers for MLflow."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hlp.files import write_csv, write_text
from hlp.reporting.tables.table import Table, lay_out, prose

_SHORT = {"estimated": "est", "true": "true", "noisy": "true±"}
ALL_TARGETS = "all targets"
_STAGES = ("region", "coarse", "fine")
_COLUMNS = ("object", *_STAGES, "targets", "add_recall", "ci95_low", "ci95_high")


def oracle_table(result: Mapping[str, Any]) -> Table:
    """A row an object and one for all targets, a column for each pair of region and coarse pose."""
    cells = result["cells"]
    heads = [head_of(cell) for cell in cells]
    per_object = [cell["per_object"] for cell in cells]
    rows = [
        [name, str(first["targets"]), *(_recall(each[name]) for each in per_object)]
        for name, first in per_object[0].items()
    ]
    adds = [cell["add"] for cell in cells]
    rows.append([ALL_TARGETS, str(adds[0]["targets"]), *map(_recall, adds)])
    return Table(["region/coarse", "targets", *heads], rows)


def head_of(cell: Mapping[str, Any]) -> str:
    """The short name of a cell of the matrix: its region and its coarse pose."""
    return f"{_SHORT[cell['region']]}/{_SHORT[cell['coarse']]}"


def format_oracle(result: Mapping[str, Any], layout: str = "text") -> str:
    """The table (`text` or `markdown`) with its caption, and the recall that each stage lost."""
    lost = ", ".join(f"{stage} {share:+.3f}" for stage, share in result["lost"].items())
    caption = (
        f"ADD(-S) recall (95 % interval) of {result['frames']} frames. Columns are region and"
        " coarse pose: est = estimated, true = replaced by the truth, true± = the true pose"
        f" turned by {result['noise_deg']:g} degrees and shifted by {result['noise_mm']:g} mm."
        " The fine pose is always estimated. The true coarse pose is given only if the region"
        " shows any part of the target."
    )
    conclusion = (
        f"Recall lost by each stage: {lost}. A wrong choice among the hypotheses counts as a"
        " loss of the coarse pose."
    )
    parts = [prose(caption, layout), lay_out(oracle_table(result), layout)]
    return "\n\n".join([*parts, prose(conclusion, layout)])


def write_oracle(folder: Path, result: Mapping[str, Any]) -> None:
    """Write oracle.md, and oracle.csv with one row for each object and cell."""
    write_text(folder / "oracle.md", format_oracle(result, "markdown") + "\n")
    rows = [
        [name, *(cell[stage] for stage in _STAGES), each["targets"], each["recall"], *each["ci95"]]
        for cell in result["cells"]
        for name, each in {**cell["per_object"], "all": cell["add"]}.items()
    ]
    write_csv(folder / "oracle.csv", _COLUMNS, rows)


def oracle_metrics(result: Mapping[str, Any]) -> dict[str, float | None]:
    """Flat numbers for MLflow, e.g. `oracle/region_true/coarse_estimated`, `oracle/lost/region`."""
    flat: dict[str, float | None] = {
        f"oracle/region_{cell['region']}/coarse_{cell['coarse']}": cell["add"]["recall"]
        for cell in result["cells"]
    }
    return flat | {f"oracle/lost/{stage}": share for stage, share in result["lost"].items()}


def _recall(recall: Mapping[str, Any]) -> str:
    low, high = recall["ci95"]
    return f"{recall['recall']:.3f} ({low:.2f}-{high:.2f})"
