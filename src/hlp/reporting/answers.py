"""What was found in a user's own frame: a line for people, plain values for programs."""

from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

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
    turn = np.rad2deg(cv2.Rodrigues(pose[:3, :3])[0].ravel())
    shift = pose[:3, 3] * MILLIMETRES_PER_METRE
    places = " ".join(f"{value:8.1f}" for value in shift)
    return f"{image:<24} {name:<16} {score:5.2f} {places} " + " ".join(
        f"{value:7.1f}" for value in turn
    )


def missing_line(image: str, name: str, reason: str) -> str:
    """Image, object, and why it was not found."""
    return f"{image:<24} {name:<16} not found: {reason}"


def pose_values(pose: Float[np.ndarray, "4 4"]) -> dict[str, list[float]]:
    """A pose with BOP's keys: `cam_R_m2c` row by row, `cam_t_m2c` in mm."""
    exact = np.asarray(pose, dtype=np.float64)
    return {
        "cam_R_m2c": exact[:3, :3].ravel().tolist(),
        "cam_t_m2c": (exact[:3, 3] * MILLIMETRES_PER_METRE).tolist(),
    }


def answer_values(
    image: str, frame: tuple[int, int], obj: tuple[int, str], found: bool, seconds: float
) -> dict[str, Any]:
    """What every answer states: image, scene and frame, object, whether it was found, time (s)."""
    return {
        "rgb": image,
        "scene_id": frame[0],
        "im_id": frame[1],
        "obj_id": obj[0],
        "object": obj[1],
        "found": found,
        "seconds": {"total": seconds},
    }
