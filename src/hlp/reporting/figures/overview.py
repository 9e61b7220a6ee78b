"""A frame with the poses of all its objects, right ones and wrong ones told apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hlp.geometry import project, transform
from hlp.records import Frame, ObjectModel
from hlp.reporting.figures.captions import titled, with_legend
from hlp.reporting.figures.panels import ESTIMATE_COLOR, axes, posed

RIGHT_COLOR, WRONG_COLOR = ESTIMATE_COLOR, (230, 97, 0)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True)
class ShownPose:
    """A pose of an object in a frame, what is written beside it, and whether it is right."""

    model: ObjectModel
    pose_cam_obj: Float[np.ndarray, "4 4"]
    words: str
    right: bool


def draw_overview(
    frame: Frame, poses: Sequence[ShownPose], title: str
) -> UInt8[np.ndarray, "_ _ 3"]:
    """The frame in colour with all poses, far ones first: shaded models, outlines, axes, names."""
    picture = frame.rgb.copy()
    far_first = sorted(poses, key=lambda each: -float(each.pose_cam_obj[2, 3]))
    for each in far_first:
        color = RIGHT_COLOR if each.right else WRONG_COLOR
        picture = posed(picture, each.model, each.pose_cam_obj, frame.camera_matrix, color)
        picture = axes(picture, each.model, each.pose_cam_obj, frame.camera_matrix)
    for each in far_first:
        _write(picture, each, frame.camera_matrix)
    legend = [("right by ADD(-S)", RIGHT_COLOR), ("wrong", WRONG_COLOR)]
    return titled(with_legend(picture, legend), title)


def _write(
    picture: UInt8[np.ndarray, "h w 3"], shown: ShownPose, camera: Float[np.ndarray, "3 3"]
) -> None:
    """The words below the object's centroid, light on dark, kept inside the picture."""
    center = transform(shown.pose_cam_obj, shown.model.centroid[None])
    if center[0, 2] <= 0:
        return
    x, y = np.clip(np.rint(project(center, camera)[0]), -1e4, 1e4).astype(int)
    (long, high), _ = cv2.getTextSize(shown.words, _FONT, 0.42, 1)
    height, width = picture.shape[:2]
    x = int(np.clip(x - long // 2, 2, max(width - long - 2, 2)))
    y = int(np.clip(y + 18, high + 2, height - 26))
    cv2.putText(picture, shown.words, (x, y), _FONT, 0.42, (20, 20, 20), 3, cv2.LINE_AA)
    cv2.putText(picture, shown.words, (x, y), _FONT, 0.42, (255, 255, 255), 1, cv2.LINE_AA)
