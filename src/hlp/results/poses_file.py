"""`poses.csv`: estimated poses in the results format of the BOP challenge; `scores.csv`."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hlp.errors import DataError
from hlp.files import read_csv, write_csv
from hlp.geometry import rigid
from hlp.records import MILLIMETRES_PER_METRE, PoseEstimate, TargetScore

POSE_COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")

_NOT_TIMED = -1.0
_ROTATION_TOLERANCE = 1e-3


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
        rotation = np.array([float(word) for word in row["R"].split()]).reshape(3, 3)
        millimetres = np.array([float(word) for word in row["t"].split()]).reshape(3)
        score, time = float(row["score"]), float(row["time"])
        scene, image, object_id = (int(row[key]) for key in POSE_COLUMNS[:3])
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{where}: no pose in BOP's format ({error})") from error
    if not np.isfinite([*rotation.ravel(), *millimetres, score]).all():
        raise DataError(f"{where}: NaN or infinity")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
        raise DataError(f"{where}: R is no rotation")
    pose = rigid(rotation, millimetres / MILLIMETRES_PER_METRE)
    seconds = {"total": time} if time >= 0 else {}
    return PoseEstimate(scene, image, object_id, pose, score, seconds)


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


_Column = tuple[str, Callable[[Any], int | float | str], Callable[[str], int | float | str]]
_WHOLE, _NUMBER, _TEXT = (int, int), (float, float), (str, str)
_VERDICT = (int, lambda text: bool(int(text)))
_LENGTH = (
    lambda metres: float(metres * MILLIMETRES_PER_METRE),
    lambda text: float(text) / MILLIMETRES_PER_METRE,
)
_ANGLE = (lambda angle: float(np.rad2deg(angle)), lambda text: float(np.deg2rad(float(text))))
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
    rows = [
        [
            write(getattr(score, field)) if field else names[score.object_id]
            for field, write, _ in _SCORES.values()
        ]
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
        except (ValueError, TypeError) as error:
            raise DataError(f"{path}, line {line}: no score ({error})") from error
        scores.append(TargetScore(**values))
        names[scores[-1].object_id] = str(row["object"])
    return scores, names
