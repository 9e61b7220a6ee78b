"""Which pixels show a target, by its true pose and the observed depth.

There are two rules because they answer two questions. Why a target was missed asks where nothing
hides it: pixels without depth count, since missing depth is one of the causes. What a perfect
region would be asks where the target's surface was really measured: that is what patches are cut
from.
"""

import numpy as np
from jaxtyping import Bool

from hlp.evaluation.errors import VSD_DELTA
from hlp.records import Frame, ObjectModel, Target
from hlp.rendering.rasterizer import render_depth

Mask = Bool[np.ndarray, "h w"]


def unoccluded_mask(frame: Frame, target: Target, model: ObjectModel) -> Mask:
    """Pixels where nothing is seen in front of the target (BOP's rule for visibility).

    The object in its true pose lies in front of the observed depth, at it, or at most `VSD_DELTA`
    behind it. Pixels without depth count. Renders `model.proxy`.
    """
    shape = (frame.depth.shape[0], frame.depth.shape[1])
    rendered = render_depth(model.proxy, target.pose_cam_obj[None], frame.camera_matrix, shape)[0]
    hidden = (frame.depth > 0) & (rendered - frame.depth > VSD_DELTA)
    return np.asarray((rendered > 0) & ~hidden)


def measured_mask(frame: Frame, target: Target, model: ObjectModel, tolerance: float) -> Mask:
    """Pixels whose observed depth is within `tolerance` (m) of the target's in its true pose.

    Renders `model.mesh`.
    """
    shape = (frame.depth.shape[0], frame.depth.shape[1])
    rendered = render_depth(
        model.mesh, target.pose_cam_obj[None], frame.camera_matrix, shape, threads=1
    )[0]
    both = (rendered > 0.0) & (frame.depth > 0.0)
    return np.asarray(both & (np.abs(rendered - frame.depth) <= tolerance))
