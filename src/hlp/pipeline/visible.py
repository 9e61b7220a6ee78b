"""Where in a frame a target can be seen."""

import numpy as np
from jaxtyping import Bool

from hlp.records import Frame, ObjectModel, Target
from hlp.rendering.rasterizer import render_depth

AGREEING = 0.02
"""How near (m) the observed depth is to the rendered one where the object is what is seen there.

Twice what true poses and the sensor are off together on LINEMOD (DESIGN: 3 to 9 mm)."""


def visible_mask(frame: Frame, target: Target, model: ObjectModel) -> Bool[np.ndarray, "h w"]:
    """Pixels of the target in its true pose whose observed depth agrees with the rendered one."""
    height, width = frame.depth.shape
    rendered = render_depth(
        model.mesh, target.pose_cam_obj[None], frame.camera_matrix, (height, width), threads=1
    )[0]
    both = (rendered > 0.0) & (frame.depth > 0.0)
    return np.asarray(both & (np.abs(rendered - frame.depth) <= AGREEING))
