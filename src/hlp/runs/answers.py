"""What was found in a user's own frame: a line for people, plain values for programs."""

from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from hlp.method.find.detections import Detection, TrackedDetection
from hlp.records import MILLIMETRES_PER_METRE

HEADER = (
    f"{'frame':<24} {'object':<16} {'score':>5} {'x mm':>8} {'y mm':>8} {'z mm':>8} "
    f"{'rx deg':>7} {'ry deg':>7} {'rz deg':>7}"
)
"""Above the lines of `pose_line`."""


def pose_line(image: str, name: str, score: float, pose: Float[np.ndarray, "4 4"]) -> str:
    """Image, object, score, translation (mm) and rotation vector (degrees).

    The rotation vector points along the axis of rotation, and its length is the angle.
    """
    shift = " ".join(f"{value:8.1f}" for value in pose[:3, 3] * MILLIMETRES_PER_METRE)
    angles = np.rad2deg(cv2.Rodrigues(pose[:3, :3])[0].ravel())
    turn = " ".join(f"{value:7.1f}" for value in angles)
    return f"{image:<24} {name:<16} {score:5.2f} {shift} {turn}"


def missing_line(image: str, name: str, reason: str) -> str:
    """Image, object, and why it was not found."""
    return f"{image:<24} {name:<16} not found: {reason}"


def detection_values(found: Detection) -> dict[str, Any]:
    """Score, pose and fit; the pose with BOP's keys: `cam_R_m2c` by rows, `cam_t_m2c` in mm.

    In a sequence also its track.
    """
    pose = np.asarray(found.pose_cam_obj, dtype=np.float64)
    values: dict[str, Any] = {
        "score": found.score,
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (pose[:3, 3] * MILLIMETRES_PER_METRE).tolist(),
        "visible_fraction": found.visible_fraction,
        "residual_mm": found.residual_mm,
    }
    if isinstance(found, TrackedDetection):
        values |= {"track": found.track, "tracked": found.tracked}
    return values
