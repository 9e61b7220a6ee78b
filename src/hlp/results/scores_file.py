"""`scores.csv`: errors and verdicts, one row for each target."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hlp.errors import DataError
from hlp.files import read_csv, write_csv
from hlp.records import MILLIMETRES_PER_METRE, TargetScore

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
