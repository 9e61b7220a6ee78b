"""Poses found in a user's own frames: a table for people, JSON for programs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hlp.records import MILLIMETRES_PER_METRE, PoseEstimate
from hlp.refinement.score_model import MIN_SCORE
from hlp.reporting.tables.table import Table


def format_poses(
    estimates: Sequence[PoseEstimate], images: Sequence[str], names: Mapping[int, str]
) -> str:
    """A row for each estimate: image, object, score, translation (mm), rotation vector (degrees).

    The rotation vector points along the axis of rotation, and its length is the angle. A row says
    so where no pose was found, and where it is more likely wrong than right. `images` holds the
    image of each estimate, `names` the objects' names by id.
    """
    rows = []
    for estimate, image in zip(estimates, images, strict=True):
        row = [image, names[estimate.object_id]]
        if estimate.pose_cam_obj is None:
            row += ["not found", "", "", "", "", "", ""]
        elif estimate.score < MIN_SCORE:
            row += [f"not found ({estimate.score:.2f})", "", "", "", "", "", ""]
        else:
            turn = Rotation.from_matrix(estimate.pose_cam_obj[:3, :3]).as_rotvec(degrees=True)
            shift = estimate.pose_cam_obj[:3, 3] * MILLIMETRES_PER_METRE
            row += [f"{estimate.score:.2f}", *(f"{value:.1f}" for value in (*shift, *turn))]
        rows.append(row)
    header = ("frame", "object", "score", "x mm", "y mm", "z mm", "rx deg", "ry deg", "rz deg")
    return Table(header, rows).text()


def poses_json(
    estimates: Sequence[PoseEstimate], images: Sequence[str], names: Mapping[int, str]
) -> dict[str, Any]:
    """The same for programs, with BOP's keys: `cam_R_m2c` row by row, `cam_t_m2c` in mm.

    `found` is false for a pose that is more likely wrong than right, which is given all the same.
    """
    return {
        "poses": [
            {
                "rgb": image,
                "scene_id": estimate.scene_id,
                "im_id": estimate.frame_id,
                "obj_id": estimate.object_id,
                "object": names[estimate.object_id],
                "found": estimate.pose_cam_obj is not None and estimate.score >= MIN_SCORE,
                "score": estimate.score,
                **_motion(estimate),
                "seconds": estimate.seconds,
            }
            for estimate, image in zip(estimates, images, strict=True)
        ]
    }


def _motion(estimate: PoseEstimate) -> dict[str, list[float]]:
    if estimate.pose_cam_obj is None:
        return {}
    pose = np.asarray(estimate.pose_cam_obj, dtype=np.float64)
    return {
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (pose[:3, 3] * MILLIMETRES_PER_METRE).tolist(),
    }
