"""Mean and spread of repeats, such as one configuration with several seeds."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from hlp.files import write_csv, write_text
from hlp.reporting.tables.table import Table, lay_out, prose


def mean_and_spread(
    repeats: Sequence[Sequence[float | None]],
) -> tuple[list[str], list[str]]:
    """Means of shares over two or more repeats, and their standard deviations.

    `repeats` holds the same shares of each repeat, None where one is not known: its cell is empty.
    """
    columns = list(zip(*repeats, strict=True))
    means = [_over_repeats(each, fmean, "{:.3f}") for each in columns]
    return means, [_over_repeats(each, stdev, "{:.4f}") for each in columns]


def _over_repeats(
    shares: Sequence[float | None], statistic: Callable[[list[float]], float], form: str
) -> str:
    known = [each for each in shares if each is not None]
    return form.format(statistic(known)) if len(known) == len(shares) else ""


_ROWS = 10


def format_search(result: Mapping[str, Any], layout: str = "text") -> str:
    """The best trials within the time limit, and the overrides of the best one.

    `result` is what `search.json` holds, `layout` is `text` or `markdown`.
    """
    limit = result["limit_ms"]
    succeeded = [each for each in result["trials"] if each["error"] is None]
    heading = (
        f"{len(result['trials'])} trials of {result['space']}, {len(succeeded)} of them with a"
        f" result; limit {limit:g} ms (median time of one object in one frame)"
    )
    best = result["best"]
    if best is None:
        conclusion = f"No trial within {limit:g} ms."
    else:
        overrides = " ".join(f"{key}={value}" for key, value in best["values"].items())
        conclusion = f"Best within the limit: {overrides}"
    table = [lay_out(trials_table(result), layout)] if succeeded else []
    return "\n\n".join([prose(heading, layout), *table, prose(conclusion, layout)])


def trials_table(result: Mapping[str, Any]) -> Table:
    """The ten best trials: those within the limit first, by recall, then by time."""
    limit = result["limit_ms"]
    succeeded = [each for each in result["trials"] if each["error"] is None]
    ranked = sorted(succeeded, key=lambda t: (t["time_ms"] > limit, -t["recall"], t["time_ms"]))
    keys = list(result["trials"][0]["values"])
    rows = []
    for each in ranked[:_ROWS]:
        time = f"{each['time_ms']:.0f}" + (" (over)" if each["time_ms"] > limit else "")
        values = [_number(each["values"][key]) for key in keys]
        rows.append([str(each["trial"]), f"{each['recall']:.3f}", time, *values])
    return Table(["trial", "ADD(-S) recall", "ms", *(key.rpartition(".")[2] for key in keys)], rows)


def write_search(folder: Path, result: Mapping[str, Any]) -> None:
    """Write search.csv, one row a trial, and search.md."""
    write_text(folder / "search.md", format_search(result, "markdown") + "\n")
    keys = list(result["trials"][0]["values"])
    rows = []
    for each in result["trials"]:
        values = [each["values"][key] for key in keys]
        outcome = (each["recall"], each["time_ms"], each["error"] or "")
        rows.append([each["trial"], *values, *outcome])
    write_csv(folder / "search.csv", ["trial", *keys, "add_recall", "median_ms", "error"], rows)


def _number(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


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
