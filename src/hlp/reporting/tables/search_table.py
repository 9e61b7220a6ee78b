"""The trials of a search as a table and as CSV."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hlp.files import write_csv, write_text
from hlp.reporting.tables.table import Table, lay_out, prose

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
