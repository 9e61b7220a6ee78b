"""`poses.csv`: estimated poses in the results format of the BOP challenge."""

from collections.abc import Mapping, Sequence
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
    for each in estimates:
        images.setdefault((each.scene_id, each.frame_id), []).append(each.seconds)
    times = {
        image: sum(sum(seconds.values()) for seconds in objects) if all(objects) else _NOT_TIMED
        for image, objects in images.items()
    }
    rows = []
    for each in estimates:
        if each.pose_cam_obj is not None:
            rows.append(pose_row(each, float(times[each.scene_id, each.frame_id])))
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
        translation = (
            np.array([float(word) for word in row["t"].split()]).reshape(3) / MILLIMETRES_PER_METRE
        )
        score, time = float(row["score"]), float(row["time"])
        ids = [int(row[key]) for key in ("scene_id", "im_id", "obj_id")]
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{where}: no pose in BOP's format ({error})") from error
    if not np.isfinite([*rotation.ravel(), *translation, score]).all():
        raise DataError(f"{where}: NaN or infinity")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
        raise DataError(f"{where}: R is no rotation")
    seconds = {"total": time} if time >= 0 else {}
    return PoseEstimate(ids[0], ids[1], ids[2], rigid(rotation, translation), score, seconds)


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


SCORE_COLUMNS = (
    "scene_id", "im_id", "obj_id", "object", "found", "visible_fraction", "add_mm", "rotation_deg",
    "translation_mm", "box_iou", "add_correct", "pose_correct", "box_correct", "mssd_recall",
    "mspd_recall", "vsd_recall", "cause", "score", "add_s_correct",
)  # fmt: skip


def write_scores(path: Path, scores: Sequence[TargetScore], names: Mapping[int, str]) -> None:
    """Write one row a target: errors in mm and degrees (`inf` where no pose), verdicts as 0 and 1.

    `names` are the objects' names by id; raises KeyError for an object that has none.
    """
    rows = [
        (
            item.scene_id,
            item.frame_id,
            item.object_id,
            names[item.object_id],
            int(item.found),
            float(item.visible_fraction),
            float(item.add_error * MILLIMETRES_PER_METRE),
            float(np.rad2deg(item.rotation_error)),
            float(item.translation_error * MILLIMETRES_PER_METRE),
            float(item.box_iou),
            int(item.add_correct),
            int(item.pose_correct),
            int(item.box_correct),
            float(item.mssd_recall),
            float(item.mspd_recall),
            float(item.vsd_recall),
            item.cause,
            float(item.score),
            int(item.add_s_correct),
        )
        for item in scores
    ]
    write_csv(path, SCORE_COLUMNS, rows)


def read_scores(path: Path) -> tuple[list[TargetScore], dict[int, str]]:
    """Scores as they were written, and the objects' names by id.

    Raises MissingFileError; DataError naming a file that has other columns or a broken line.
    """
    scores, names = [], {}
    for line, row in enumerate(read_csv(path, SCORE_COLUMNS), start=2):
        scores.append(_score(row, f"{path}, line {line}"))
        names[scores[-1].object_id] = str(row["object"])
    return scores, names


def _score(row: Mapping[str, Any], where: str) -> TargetScore:
    try:
        return TargetScore(
            scene_id=int(row["scene_id"]),
            frame_id=int(row["im_id"]),
            object_id=int(row["obj_id"]),
            found=bool(int(row["found"])),
            visible_fraction=float(row["visible_fraction"]),
            add_error=float(row["add_mm"]) / MILLIMETRES_PER_METRE,
            rotation_error=float(np.deg2rad(float(row["rotation_deg"]))),
            translation_error=float(row["translation_mm"]) / MILLIMETRES_PER_METRE,
            box_iou=float(row["box_iou"]),
            add_correct=bool(int(row["add_correct"])),
            pose_correct=bool(int(row["pose_correct"])),
            box_correct=bool(int(row["box_correct"])),
            mssd_recall=float(row["mssd_recall"]),
            mspd_recall=float(row["mspd_recall"]),
            vsd_recall=float(row["vsd_recall"]),
            cause=str(row["cause"]),
            score=float(row["score"]),
            add_s_correct=bool(int(row["add_s_correct"])),
        )
    except (ValueError, TypeError) as error:
        raise DataError(f"{where}: no score ({error})") from error
