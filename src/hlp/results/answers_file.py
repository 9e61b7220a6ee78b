"""Answers of `hlp predict`, written while frames are processed: BOP's CSV and JSON lines.

A call that was stopped leaves the answers so far, and what it was asked for: the next call with the
same request continues after them.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from filelock import FileLock, Timeout

from hlp.errors import InputError
from hlp.files import POSES, replaced, write_text
from hlp.records import PoseEstimate
from hlp.results.poses_file import POSE_COLUMNS, pose_row

LINES, JSON = "poses.jsonl", "poses.json"
_LOCK, _REQUEST = ".poses.lock", ".poses.request"
_FrameIds = tuple[int, int]


class AnswersFile:
    """Opens `poses.csv` and `poses.jsonl` in a folder; every answer is on disk when it is added.

    When all is done, `poses.json` holds the same as the lines do, as one document. `request` stands
    for all that decides the answers. Frames that a stopped call with an equal one has answered are
    in `answered`, by (scene id, image id): whether they could be used. Their answers stay; those of
    its last frame, which may be incomplete, are removed. Without a request all begins anew. Raises
    InputError if another process writes into the folder.
    """

    answered: Mapping[_FrameIds, bool]

    def __init__(self, folder: Path, request: str = "") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._lock = FileLock(folder / _LOCK)  # released by the system if the process dies
        try:
            self._lock.acquire(timeout=0)
        except Timeout as error:
            raise InputError(
                f"another process writes into {folder}: wait for it, or name another folder"
            ) from error
        kept, rows = self._kept(request)
        self.answered = {_ids(answer): "error" not in answer for answer in kept}
        (folder / JSON).unlink(missing_ok=True)
        (folder / _REQUEST).unlink(missing_ok=True)
        write_text(folder / LINES, "".join(f"{json.dumps(answer)}\n" for answer in kept))
        write_text(folder / POSES, "".join([",".join(POSE_COLUMNS) + "\n", *self._own(rows)]))
        write_text(folder / _REQUEST, request)
        self._csv = (folder / POSES).open("a", encoding="utf-8")
        self._lines = (folder / LINES).open("a", encoding="utf-8")

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
        try:
            if error is None:
                self._write_json()
                (self._folder / _REQUEST).unlink(missing_ok=True)
        finally:
            self._lock.release()
            (self._folder / _LOCK).unlink(missing_ok=True)

    def add(self, answer: Mapping[str, Any], estimate: PoseEstimate | None) -> None:
        """Add one answer as a line of JSON and, if it is an `estimate`, as a row of the CSV."""
        self._lines.write(json.dumps(answer) + "\n")
        self._lines.flush()
        if estimate is not None:
            seconds = sum(estimate.seconds.values())
            self._csv.write(",".join(map(str, pose_row(estimate, seconds))) + "\n")
            self._csv.flush()

    def _kept(self, request: str) -> tuple[list[dict[str, Any]], list[str]]:
        """The answers of a stopped call that are to stay, and all rows of its CSV."""
        try:
            if not request or (self._folder / _REQUEST).read_text("utf-8") != request:
                return [], []
            lines = (self._folder / LINES).read_text("utf-8").splitlines()
            rows = (self._folder / POSES).read_text("utf-8").splitlines()[1:]
        except (OSError, UnicodeDecodeError):
            return [], []
        found = [*takewhile(bool, map(_answer, lines))]
        return [answer for answer in found if _ids(answer) != _ids(found[-1])], rows

    def _own(self, rows: Sequence[str]) -> Iterator[str]:
        """The rows of those frames that are answered."""
        names = {f"{scene},{image}" for scene, image in self.answered}
        for row in rows:
            if ",".join(row.split(",", 2)[:2]) in names:
                yield f"{row}\n"

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


def _answer(line: str) -> dict[str, Any]:
    """The answer of a line; empty if it is damaged."""
    try:
        content: dict[str, Any] = json.loads(line)
        return content if all(type(number) is int for number in _ids(content)) else {}
    except (ValueError, KeyError, TypeError):
        return {}


def _ids(answer: Mapping[str, Any]) -> _FrameIds:
    return answer["scene_id"], answer["im_id"]
