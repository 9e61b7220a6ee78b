"""`poses.csv`: estimated poses in the results format of the BOP challenge; `scores.csv`.

`AnswersFile` holds the answers of `hlp predict`, written while frames are processed: BOP's CSV and
JSON lines. A call that was stopped leaves the answers so far, and what it was asked for: the next
call with the same request continues after them.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from itertools import takewhile
from pathlib import Path
from typing import Any, Self

import numpy as np

from hlp.errors import DataError
from hlp.files import POSES, read_csv, replaced, write_csv, write_text
from hlp.folders import locked
from hlp.geometry import rigid
from hlp.records import MILLIMETRES_PER_METRE, PoseEstimate, TargetScore
from hlp.schemas import exact_rotation, number, whole_id

POSE_COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")

_NOT_TIMED = -1.0
_ROTATION_TOLERANCE = 1e-3
_MOST = 1e9  # of a number in poses.csv


def write_poses(path: Path, estimates: Sequence[PoseEstimate]) -> None:
    """Write one row for each estimate that has a pose: R row by row, t in mm.

    Pass the estimates of all objects that were looked for, also those without a pose: BOP's `time`
    is that of the whole image in seconds, the sum over all of them. It is -1 where any of them was
    not timed. Numbers are exact (shortest round trip).
    """
    images: dict[tuple[int, int], list[dict[str, float]]] = {}
    for estimate in estimates:
        images.setdefault((estimate.scene_id, estimate.frame_id), []).append(estimate.seconds)
    times = {
        image: sum(sum(seconds.values()) for seconds in objects) if all(objects) else _NOT_TIMED
        for image, objects in images.items()
    }
    rows = [
        pose_row(estimate, float(times[estimate.scene_id, estimate.frame_id]))
        for estimate in estimates
        if estimate.pose_cam_obj is not None
    ]
    write_csv(path, POSE_COLUMNS, rows)


def pose_row(estimate: PoseEstimate, seconds: float) -> tuple[int | float | str, ...]:
    """The row of an estimate with a pose; `seconds` are those of its whole image."""
    pose = np.asarray(estimate.pose_cam_obj, dtype=np.float64)
    head = (estimate.scene_id, estimate.frame_id, estimate.object_id, float(estimate.score))
    rotation = _numbers(pose[:3, :3])
    return (*head, rotation, _numbers(pose[:3, 3] * MILLIMETRES_PER_METRE), seconds)


def read_poses(path: Path) -> list[PoseEstimate]:
    """Read BOP's CSV; `seconds` holds the image's time as `total`, nothing where it was -1.

    Raises MissingFileError; DataError naming the line that is not BOP's or holds no pose.
    """
    rows = enumerate(read_csv(path, POSE_COLUMNS), start=2)
    return [_estimate(row, f"{path}, line {line}") for line, row in rows]


def _estimate(row: Mapping[str, Any], where: str) -> PoseEstimate:
    try:
        rotation = np.array([number(word) for word in row["R"].split()]).reshape(3, 3)
        millimetres = np.array([number(word) for word in row["t"].split()]).reshape(3)
        score, time = number(row["score"]), number(row["time"])
        scene, image, object_id = (whole_id(row[key]) for key in POSE_COLUMNS[:3])
    except ValueError as error:
        raise DataError(f"{where}: no pose in BOP's format ({error})") from error
    if not (np.abs([*rotation.ravel(), *millimetres, score, time]) <= _MOST).all():
        raise DataError(f"{where}: NaN, or a number beyond {_MOST:g}")
    exact_rotation(rotation, f"{where}: R", _ROTATION_TOLERANCE)
    pose = rigid(rotation, millimetres / MILLIMETRES_PER_METRE)
    seconds = {"total": time} if time >= 0 else {}
    return PoseEstimate(scene, image, object_id, pose, score, seconds)


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _share(text: str) -> float:
    """A number from 0 to 1, or nan where it was not computed."""
    share = number(text)
    if share < 0.0 or share > 1.0:
        raise ValueError(f"{text} is not between 0 and 1")
    return share


def _size(text: str) -> float:
    """A number from 0, also infinity."""
    if not (size := number(text)) >= 0.0:
        raise ValueError(f"{text} is negative or no number")
    return size


_Column = tuple[str, Callable[[Any], int | float | str], Callable[[str], int | float | str]]
_WHOLE, _NUMBER, _TEXT = (int, whole_id), (float, _share), (str, str)
_VERDICT = (int, {"0": False, "1": True}.__getitem__)
_LENGTH = (
    lambda metres: float(metres * MILLIMETRES_PER_METRE),
    lambda text: _size(text) / MILLIMETRES_PER_METRE,
)
_ANGLE = (lambda angle: float(np.rad2deg(angle)), lambda text: float(np.deg2rad(_size(text))))
_SCORES: dict[str, _Column] = {
    "scene_id": ("scene_id", *_WHOLE),
    "im_id": ("frame_id", *_WHOLE),
    "obj_id": ("object_id", *_WHOLE),
    "object": ("", *_TEXT),
    "found": ("found", *_VERDICT),
    "visible_fraction": ("visible_fraction", *_NUMBER),
    "add_mm": ("add_error", *_LENGTH),
    "rotation_deg": ("rotation_error", *_ANGLE),
    "translation_mm": ("translation_error", *_LENGTH),
    "box_iou": ("box_iou", *_NUMBER),
    "add_correct": ("add_correct", *_VERDICT),
    "pose_correct": ("pose_correct", *_VERDICT),
    "box_correct": ("box_correct", *_VERDICT),
    "mssd_recall": ("mssd_recall", *_NUMBER),
    "mspd_recall": ("mspd_recall", *_NUMBER),
    "vsd_recall": ("vsd_recall", *_NUMBER),
    "cause": ("cause", *_TEXT),
    "score": ("score", *_NUMBER),
    "add_s_correct": ("add_s_correct", *_VERDICT),
}
"""Each column of scores.csv: the score's field, and what writes and reads a value of it.

`object`, the object's name, is no field of a score.
"""
SCORE_COLUMNS = tuple(_SCORES)


def write_scores(path: Path, scores: Sequence[TargetScore], names: Mapping[int, str]) -> None:
    """Write one row a target: errors in mm and degrees (`inf` where no pose), verdicts as 0 and 1.

    `names` are the objects' names by id; raises KeyError for an object that has none.
    """
    columns = [(key, write) for key, write, _ in _SCORES.values()]
    rows = [
        [write(getattr(score, key)) if key else names[score.object_id] for key, write in columns]
        for score in scores
    ]
    write_csv(path, SCORE_COLUMNS, rows)


def read_scores(path: Path) -> tuple[list[TargetScore], dict[int, str]]:
    """Scores as they were written, and the objects' names by id.

    Raises MissingFileError; DataError naming a file that has other columns or a broken line.
    """
    scores, names = [], {}
    for line, row in enumerate(read_csv(path, SCORE_COLUMNS), start=2):
        try:
            values: dict[str, Any] = {
                field: read(row[column]) for column, (field, _, read) in _SCORES.items() if field
            }
        except (ValueError, KeyError) as error:
            raise DataError(f"{path}, line {line}: no score ({error})") from error
        scores.append(TargetScore(**values))
        names[scores[-1].object_id] = str(row["object"])
    return scores, names


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
        self._opened = ExitStack()
        self._opened.callback((folder / _LOCK).unlink, missing_ok=True)
        problem = f"another process writes into {folder}: wait for it, or name another folder"
        self._opened.enter_context(locked(folder / _LOCK, problem))
        kept, rows = self._kept(request)
        self.answered = {_ids(answer): "error" not in answer for answer in kept}
        (folder / JSON).unlink(missing_ok=True)
        (folder / _REQUEST).unlink(missing_ok=True)
        write_text(folder / LINES, "".join(f"{json.dumps(answer)}\n" for answer in kept))
        write_text(folder / POSES, "".join(f"{row}\n" for row in (",".join(POSE_COLUMNS), *rows)))
        write_text(folder / _REQUEST, request)
        self._csv, self._lines = (
            self._opened.enter_context((folder / name).open("a", encoding="utf-8"))
            for name in (POSES, LINES)
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        with self._opened:
            if kind is None:
                self._write_json()
                (self._folder / _REQUEST).unlink(missing_ok=True)

    def add(self, answer: Mapping[str, Any], estimate: PoseEstimate | None) -> None:
        """Add one answer as a line of JSON and, if it is an `estimate`, as a row of the CSV."""
        self._lines.write(json.dumps(answer) + "\n")
        self._lines.flush()
        if estimate is not None:
            seconds = sum(estimate.seconds.values())
            self._csv.write(",".join(map(str, pose_row(estimate, seconds))) + "\n")
            self._csv.flush()

    def _kept(self, request: str) -> tuple[list[dict[str, Any]], list[str]]:
        """The answers of a stopped call that are to stay, and the rows of their frames."""
        try:
            if not request or (self._folder / _REQUEST).read_text("utf-8") != request:
                return [], []
            lines = (self._folder / LINES).read_text("utf-8").splitlines()
            rows = (self._folder / POSES).read_text("utf-8").splitlines()[1:]
        except (OSError, UnicodeDecodeError):
            return [], []
        found = [*takewhile(bool, map(_answer, lines))]
        kept = [answer for answer in found if _ids(answer) != _ids(found[-1])]
        frames = {"{},{}".format(*_ids(answer)) for answer in kept}
        return kept, [row for row in rows if ",".join(row.split(",", 2)[:2]) in frames]

    def _write_json(self) -> None:
        """One document made line by line, since there may be a great many."""
        with (self._folder / LINES).open("rb") as lines, replaced(self._folder / JSON) as stream:
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
