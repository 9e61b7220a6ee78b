"""`poses.csv` (BOP's results format) and `scores.csv` (one row a target), written whole or not."""

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hlp.geometry import rigid
from hlp.records import PoseEstimate, TargetScore

POSE_COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
SCORE_COLUMNS = (
    "scene_id", "im_id", "obj_id", "object", "found", "visible_fraction", "add_mm", "rotation_deg",
    "translation_mm", "box_iou", "add_correct", "pose_correct", "box_correct", "mssd_recall",
    "mspd_recall", "vsd_recall", "cause",
)  # fmt: skip

_MM = 1e3
_UNTIMED = -1.0
_ROTATION_TOLERANCE = 1e-3


def write_poses(path: Path, estimates: Sequence[PoseEstimate]) -> None:
    """Write BOP's CSV: R row-major, t in mm; an estimate without a pose has no row.

    `time` is that of the whole image in seconds, as BOP wants it: the sum over its estimates,
    those without a pose too; -1 where none was timed. Numbers are exact (shortest round trip).
    """
    times: dict[tuple[int, int], float] = {}
    for item in estimates:
        if item.seconds:
            frame = (item.scene_id, item.frame_id)
            times[frame] = times.get(frame, 0.0) + sum(item.seconds.values())
    rows = []
    for item in estimates:
        if item.pose_cam_obj is None:
            continue
        pose = np.asarray(item.pose_cam_obj, dtype=np.float64)
        time = times.get((item.scene_id, item.frame_id), _UNTIMED)
        rotation, translation = _numbers(pose[:3, :3]), _numbers(pose[:3, 3] * _MM)
        head = (item.scene_id, item.frame_id, item.object_id, float(item.score))
        rows.append((*head, rotation, translation, float(time)))
    _write(path, POSE_COLUMNS, rows)


def read_poses(path: Path) -> list[PoseEstimate]:
    """Read BOP's CSV; `seconds` holds the image's time as `total`, nothing where it was -1.

    Raises FileNotFoundError; ValueError naming the line that is not BOP's or holds no pose.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no poses {path}: run the poses stage first")
    with path.open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        if tuple(reader.fieldnames or ()) != POSE_COLUMNS:
            raise ValueError(f"{path}: the first line must be {','.join(POSE_COLUMNS)}")
        return [_estimate(row, f"{path}, line {reader.line_num}") for row in reader]


def write_scores(path: Path, scores: Sequence[TargetScore], names: Mapping[int, str]) -> None:
    """Write one row a target: errors in mm and degrees (`inf` where no pose), verdicts as 0 and 1.

    Raises KeyError for an object without a name.
    """
    rows = [
        (
            item.scene_id,
            item.frame_id,
            item.object_id,
            names[item.object_id],
            int(item.found),
            float(item.visible_fraction),
            float(item.add_error * _MM),
            float(np.rad2deg(item.rotation_error)),
            float(item.translation_error * _MM),
            float(item.box_iou),
            int(item.add_correct),
            int(item.pose_correct),
            int(item.box_correct),
            float(item.mssd_recall),
            float(item.mspd_recall),
            float(item.vsd_recall),
            item.cause,
        )
        for item in scores
    ]
    _write(path, SCORE_COLUMNS, rows)


def read_scores(path: Path) -> list[TargetScore]:
    """Read `scores.csv` back. Raises FileNotFoundError; ValueError naming a line that is broken."""
    if not path.is_file():
        raise FileNotFoundError(f"no scores {path}: score the poses first")
    with path.open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        # The last column, the cause, came later: older files lack it.
        if tuple(reader.fieldnames or ()) not in (SCORE_COLUMNS, SCORE_COLUMNS[:-1]):
            raise ValueError(f"{path}: the first line must be {','.join(SCORE_COLUMNS)}")
        return [_score(row, f"{path}, line {reader.line_num}") for row in reader]


def _estimate(row: Mapping[str, Any], where: str) -> PoseEstimate:
    try:
        rotation = np.array([float(word) for word in row["R"].split()]).reshape(3, 3)
        translation = np.array([float(word) for word in row["t"].split()]).reshape(3) / _MM
        score, time = float(row["score"]), float(row["time"])
        ids = [int(row[key]) for key in ("scene_id", "im_id", "obj_id")]
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{where}: no pose in BOP's format ({error})") from error
    if not np.isfinite([*rotation.ravel(), *translation, score]).all():
        raise ValueError(f"{where}: NaN or infinity")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
        raise ValueError(f"{where}: R is no rotation")
    seconds = {"total": time} if time >= 0 else {}
    return PoseEstimate(ids[0], ids[1], ids[2], rigid(rotation, translation), score, seconds)


def _score(row: Mapping[str, Any], where: str) -> TargetScore:
    try:
        return TargetScore(
            scene_id=int(row["scene_id"]),
            frame_id=int(row["im_id"]),
            object_id=int(row["obj_id"]),
            found=bool(int(row["found"])),
            visible_fraction=float(row["visible_fraction"]),
            add_error=float(row["add_mm"]) / _MM,
            rotation_error=float(np.deg2rad(float(row["rotation_deg"]))),
            translation_error=float(row["translation_mm"]) / _MM,
            box_iou=float(row["box_iou"]),
            add_correct=bool(int(row["add_correct"])),
            pose_correct=bool(int(row["pose_correct"])),
            box_correct=bool(int(row["box_correct"])),
            mssd_recall=float(row["mssd_recall"]),
            mspd_recall=float(row["mspd_recall"]),
            vsd_recall=float(row["vsd_recall"]),
            cause=row.get("cause", ""),
        )
    except (ValueError, TypeError) as error:
        raise ValueError(f"{where}: no score ({error})") from error


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _write(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with partial.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(rows)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
