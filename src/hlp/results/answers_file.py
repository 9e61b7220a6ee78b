"""Answers of `hlp predict`, written while frames are processed: BOP's CSV and JSON lines."""

import json
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hlp.files import POSES, replaced
from hlp.records import PoseEstimate
from hlp.results.poses_file import POSE_COLUMNS, pose_row

LINES, JSON = "poses.jsonl", "poses.json"


class AnswersFile:
    """Opens `poses.csv` and `poses.jsonl` in a folder; every answer is on disk when it is added.

    When all is done, `poses.json` holds the same as the lines do, as one document.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        (folder / JSON).unlink(missing_ok=True)
        self._csv = (folder / POSES).open("w", encoding="utf-8")
        self._lines = (folder / LINES).open("w", encoding="utf-8")
        self._csv.write(",".join(POSE_COLUMNS) + "\n")
        self._csv.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._csv.close()
        self._lines.close()
        if error is None:
            self._write_json()

    def add(self, answer: Mapping[str, Any], estimate: PoseEstimate | None) -> None:
        """Add one answer as a line of JSON and, if it is an `estimate`, as a row of the CSV."""
        self._lines.write(json.dumps(answer) + "\n")
        self._lines.flush()
        if estimate is not None:
            seconds = sum(estimate.seconds.values())
            self._csv.write(",".join(map(str, pose_row(estimate, seconds))) + "\n")
            self._csv.flush()

    def _write_json(self) -> None:
        """One document made line by line, since there may be a great many."""
        with (
            (self._folder / LINES).open("rb") as lines,
            replaced(self._folder / JSON) as stream,
        ):
            stream.write(b'{"poses": [\n')
            for number, line in enumerate(lines):
                stream.write((b",\n" if number else b"") + line.rstrip(b"\n"))
            stream.write(b"\n]}\n")
