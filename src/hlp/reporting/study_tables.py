"""Tables, CSV files and metrics of the studies: bench, oracle, basin, search."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from hlp.files import read_csv, write_csv, write_text
from hlp.reporting.table import Table, lay_out, prose

Result = Mapping[str, Any]

_SHORT = {"estimated": "est", "true": "true"}
ALL_TARGETS = "all targets"
_STAGES = ("region", "coarse")
_ORACLE = ("object", *_STAGES, "targets", "add_recall", "ci95_low", "ci95_high")


def head_of(cell: Mapping[str, Any]) -> str:
    """The short name of a cell of the oracle matrix: its region and its coarse pose."""
    return f"{_SHORT[cell['region']]}/{_SHORT[cell['coarse']]}"


def oracle_table(result: Result) -> Table:
    """A row an object and one for all targets, a column for each pair of region and coarse pose."""
    found = [{**cell["per_object"], ALL_TARGETS: cell["add"]} for cell in result["cells"]]
    rows = [
        [name, str(first["targets"]), *(_recall(recalls[name]) for recalls in found)]
        for name, first in found[0].items()
    ]
    return Table(["region/coarse", "targets", *map(head_of, result["cells"])], rows)


def _recall(recall: Mapping[str, Any]) -> str:
    low, high = recall["ci95"]
    return f"{recall['recall']:.3f} ({low:.2f}-{high:.2f})"


def format_oracle(result: Result, layout: str = "text") -> str:
    """The table (`text` or `markdown`) with its caption, and the recall that each stage lost."""
    lost = ", ".join(f"{stage} {share:+.3f}" for stage, share in result["lost"].items())
    caption = (
        f"ADD(-S) recall (95 % interval) of {result['frames']} frames. Columns are region and"
        " coarse pose: est = estimated, true = replaced by the truth. The fine pose is always"
        " estimated. The true coarse pose is given only if the region shows any part of the target."
    )
    conclusion = (
        f"Recall lost by each stage: {lost}. A wrong choice among the hypotheses counts as a"
        " loss of the coarse pose."
    )
    parts = [prose(caption, layout), lay_out(oracle_table(result), layout)]
    return "\n\n".join([*parts, prose(conclusion, layout)])


def write_oracle(folder: Path, result: Result) -> None:
    """Write oracle.md, and oracle.csv with one row for each object and cell."""
    write_text(folder / "oracle.md", format_oracle(result, "markdown") + "\n")
    rows = [
        [name, *(cell[stage] for stage in _STAGES), add["targets"], add["recall"], *add["ci95"]]
        for cell in result["cells"]
        for name, add in {**cell["per_object"], "all": cell["add"]}.items()
    ]
    write_csv(folder / "oracle.csv", _ORACLE, rows)


ALL = "all"
_CELL = ["refiner", "object", "rotation_deg", "translation_mm"]
_BASIN = [*_CELL, "perturbations", "right", "add_recall"]


def basin_cells(tried: pd.DataFrame) -> pd.DataFrame:
    """What basin.csv holds: recall by refiner, object (all first) and pair of starting errors.

    `tried` has a row for each refined pose: refiner, object, both errors, and whether it is right.
    """
    groups = [
        part.assign(object=name)
        for _, own in tried.groupby("refiner", sort=False)
        for name, part in [(ALL, own), *own.groupby("object", sort=False)]
    ]
    cells = pd.concat(groups).groupby(_CELL, sort=False)["right"]
    return cells.agg(perturbations="size", right="sum", add_recall="mean").reset_index()


def write_basins(folder: Path, cells: pd.DataFrame) -> None:
    """Write basin.md, and basin.csv: a row a refiner, object and pair of starting errors."""
    write_text(folder / "basin.md", format_basins(cells, "markdown") + "\n")
    write_csv(folder / "basin.csv", _BASIN, cells[_BASIN].to_numpy().tolist())


def read_mean_recalls(path: Path) -> dict[str, float]:
    """Recall of all objects by refiner, the mean over all starting errors, from basin.csv.

    Raises MissingFileError, DataError for another file, and ValueError without a number.
    """
    cells = pd.DataFrame(read_csv(path, _BASIN), columns=_BASIN)
    whole = cells[cells["object"] == ALL].astype({"add_recall": float})
    means: dict[str, float] = whole.groupby("refiner", sort=False)["add_recall"].mean().to_dict()
    return means


def format_basins(cells: pd.DataFrame, layout: str = "text") -> str:
    """Tables for people (`text` or `markdown`): recall by pair of errors, and means per object."""
    caption = (
        "ADD(-S) recall after refinement, by the error of the start: a row for each rotation"
        " (degrees), a column for each translation (mm)."
    )
    parts = [prose(caption, layout)]
    for refiner, own in cells[cells["object"] == ALL].groupby("refiner", sort=False):
        recalls = recalls_by_errors(own)
        rows = [[f"{degrees:g}", *map("{:.2f}".format, row)] for degrees, row in recalls.iterrows()]
        header = [str(refiner), *map("{:g}".format, recalls.columns)]
        parts.append(lay_out(Table(header, rows), layout))
    means = cells.pivot_table("add_recall", "object", "refiner", sort=False)
    counts = cells.groupby("object", sort=False)["perturbations"].first()
    rows = [
        [str(name), str(counts[name]), *map("{:.3f}".format, row)] for name, row in means.iterrows()
    ]
    parts.append("Mean over all starting errors:")
    header = ["object", "perturbations each", *means.columns]
    return "\n\n".join([*parts, lay_out(Table(header, rows), layout)])


def recalls_by_errors(cells: pd.DataFrame) -> pd.DataFrame:
    """Recalls of one refiner and object: rotation errors down, translation errors across."""
    return cells.pivot_table("add_recall", "rotation_deg", "translation_mm", sort=False)


_TRIALS = 10  # that are shown


def format_search(result: Result, layout: str = "text") -> str:
    """The best trials within the time limit, and the overrides of the best one.

    `result` is what `search.json` holds, `layout` is `text` or `markdown`.
    """
    limit, best = result["limit_ms"], result["best"]
    succeeded = [trial for trial in result["trials"] if trial["error"] is None]
    heading = (
        f"{len(result['trials'])} trials of {result['space']}, {len(succeeded)} of them with a"
        f" result; limit {limit:g} ms (median time of one object in one frame)"
    )
    conclusion = f"No trial within {limit:g} ms."
    if best is not None:
        overrides = " ".join(f"{key}={value}" for key, value in best["values"].items())
        conclusion = f"Best within the limit: {overrides}"
        if best["trial"] == 0:
            conclusion += " (unchanged: no other trial is surely better)"
    table = [lay_out(trials_table(result), layout)] if succeeded else []
    return "\n\n".join([prose(heading, layout), *table, prose(conclusion, layout)])


def trials_table(result: Result) -> Table:
    """The ten best trials: those within the limit first, by recall, then by time."""
    limit = result["limit_ms"]
    succeeded = [trial for trial in result["trials"] if trial["error"] is None]
    ranked = sorted(succeeded, key=lambda t: (t["time_ms"] > limit, -t["recall"], t["time_ms"]))
    keys, rows = list(result["trials"][0]["values"]), []
    for trial in ranked[:_TRIALS]:
        time = f"{trial['time_ms']:.0f}" + (" (over)" if trial["time_ms"] > limit else "")
        values = (trial["values"][key] for key in keys)
        shown = [f"{value:.3g}" if isinstance(value, float) else str(value) for value in values]
        rows.append([str(trial["trial"]), f"{trial['recall']:.3f}", time, *shown])
    return Table(["trial", "ADD(-S) recall", "ms", *(key.rpartition(".")[2] for key in keys)], rows)


def write_search(folder: Path, result: Result) -> None:
    """Write search.csv, one row a trial, and search.md."""
    write_text(folder / "search.md", format_search(result, "markdown") + "\n")
    keys = list(result["trials"][0]["values"])
    rows = []
    for trial in result["trials"]:
        values = [trial["values"][key] for key in keys]
        rows.append(
            [trial["trial"], *values, trial["recall"], trial["time_ms"], trial["error"] or ""]
        )
    write_csv(folder / "search.csv", ["trial", *keys, "add_recall", "median_ms", "error"], rows)
