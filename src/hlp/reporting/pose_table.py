"""Poses found in frames without known truth, for people (a table) and programs (JSON)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hlp.records import PoseEstimate
from hlp.reporting.tables import Table

_MM = 1e3


def format_poses(
    answers: Sequence[PoseEstimate], images: Sequence[str], names: Mapping[int, str]
) -> str:
    """A row an answer: its image and object, the score, translation (mm) and rotation vector.

    The rotation vector (degrees) points along the axis, its length is the angle. Where no pose was
    found the row says so.
    """
    rows = []
    for answer, image in zip(answers, images, strict=True):
        row = [image, names[answer.object_id]]
        if answer.pose_cam_obj is None:
            row += ["not found", "", "", "", "", "", ""]
        else:
            turn = Rotation.from_matrix(answer.pose_cam_obj[:3, :3]).as_rotvec(degrees=True)
            shift = answer.pose_cam_obj[:3, 3] * _MM
            row += [f"{answer.score:.2f}", *(f"{value:.1f}" for value in (*shift, *turn))]
        rows.append(row)
    header = ("frame", "object", "score", "x mm", "y mm", "z mm", "rx deg", "ry deg", "rz deg")
    return Table(header, rows).text()


def poses_json(
    answers: Sequence[PoseEstimate], images: Sequence[str], names: Mapping[int, str]
) -> dict[str, Any]:
    """The same for programs, with BOP's names: `cam_R_m2c` row by row, `cam_t_m2c` in mm."""
    return {
        "poses": [
            {
                "rgb": image,
                "scene_id": answer.scene_id,
                "im_id": answer.frame_id,
                "obj_id": answer.object_id,
                "object": names[answer.object_id],
                "found": answer.pose_cam_obj is not None,
                "score": answer.score,
                **_motion(answer),
                "seconds": answer.seconds,
            }
            for answer, image in zip(answers, images, strict=True)
        ]
    }


def _motion(answer: PoseEstimate) -> dict[str, list[float]]:
    if answer.pose_cam_obj is None:
        return {}
    pose = np.asarray(answer.pose_cam_obj, dtype=np.float64)
    return {
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (pose[:3, 3] * _MM).tolist(),
    }
