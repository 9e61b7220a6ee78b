"""`poses.csv`: estimated poses in the results format of the BOP challenge."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hlp.errors import DataError
from hlp.files import read_csv, write_csv
from hlp.geometry import rigid
from hlp.records import MILLIMETRES_PER_METRE, PoseEstimate

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
