"""The pixels of a frame that show a target."""

import numpy as np
from jaxtyping import Bool

from hlp.data.sources import FrameSource, VisibleMasks
from hlp.records import Frame, ObjectModel, Target
from hlp.rendering.rasterizer import render_depth


def visible_mask(
    source: FrameSource, frame: Frame, target: Target, model: ObjectModel, tolerance: float
) -> Bool[np.ndarray, "h w"]:
    """Pixels that show the target: the data set's own mask, or else where the depth agrees.

    The depth agrees where the observed one is within `tolerance` (m) of that of the object rendered
    in its true pose.
    """
    if isinstance(source, VisibleMasks):
        given = source.visible_mask(frame, target)
        if given is not None:
            return given
    height, width = frame.depth.shape
    rendered = render_depth(
        model.mesh, target.pose_cam_obj[None], frame.camera_matrix, (height, width), threads=1
    )[0]
    both = (rendered > 0.0) & (frame.depth > 0.0)
    return np.asarray(both & (np.abs(rendered - frame.depth) <= tolerance))
