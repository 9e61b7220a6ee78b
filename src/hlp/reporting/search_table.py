"""A search's trials as a table for people, and as CSV."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_SHOWN = 10


def format_search(result: Mapping[str, Any]) -> str:
    """The best trials within the limit as Markdown, and how to run with the best one's values.

    `result` is what `search.json` holds.
    """
    limit = result["limit_ms"]
    right = [each for each in result["trials"] if each["error"] is None]
    ranked = sorted(right, key=lambda t: (t["time_ms"] > limit, -t["recall"], t["time_ms"]))
    keys = list(result["trials"][0]["values"])
    lines = [
        f"{len(result['trials'])} trials of {result['space']}, {len(right)} of them with a result;"
        f" limit {limit:g} ms (median of a target)",
        "",
        f"| trial | AD recall | ms | {' | '.join(key.rpartition('.')[2] for key in keys)} |",
        "|" + "---:|" * (3 + len(keys)),
    ]
    for each in ranked[:_SHOWN]:
        time = f"{each['time_ms']:.0f}" + (" (over)" if each["time_ms"] > limit else "")
        values = " | ".join(_number(each["values"][key]) for key in keys)
        lines.append(f"| {each['trial']} | {each['recall']:.3f} | {time} | {values} |")
    best = result["best"]
    if best is None:
        return "\n".join([*lines, "", f"No trial within {limit:g} ms."])
    overrides = " ".join(f"{key}={value}" for key, value in best["values"].items())
    return "\n".join([*lines, "", f"Best within the limit: {overrides}"])


def write_search(folder: Path, result: Mapping[str, Any]) -> None:
    """Write search.csv, one row a trial, and search.md."""
    (folder / "search.md").write_text(format_search(result) + "\n")
    keys = list(result["trials"][0]["values"])
    with (folder / "search.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["trial", *keys, "add_recall", "median_ms", "error"])
        for each in result["trials"]:
            values = [each["values"][key] for key in keys]
            error = each["error"] or ""
            writer.writerow([each["trial"], *values, each["recall"], each["time_ms"], error])


def _number(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
