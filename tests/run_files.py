"""Reading what a run leaves in its output folder."""

import csv
import json
from pathlib import Path
from typing import Any

Row = dict[str, str]


def rows(path: Path) -> list[Row]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def read_json(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def stages(output: Path, *, reused: bool) -> dict[str, int]:
    """How many outputs of each stage a run reused or made, by its manifest."""
    counts: dict[str, int] = {}
    for event in read_json(output / "manifest.json")["stages"]:
        if event["reused"] == reused:
            counts[event["stage"]] = counts.get(event["stage"], 0) + 1
    return counts
