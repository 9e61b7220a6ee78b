"""The results of all stages for one object in one frame, as one picture."""

import numpy as np
from jaxtyping import UInt8

from hlp.records import Frame, PoseEstimate, Target
from hlp.reporting.figures.panels import draw_panels
from hlp.stages.detection import DetectionStages
from hlp.stages.frame_results import read_regions


def picture_of_stages(
    detection: DetectionStages,
    frame: Frame,
    object_id: int,
    estimate: PoseEstimate | None,
    truth: Target | None,
) -> UInt8[np.ndarray, "_ _ 3"]:
    """The paper's four panels (Fig. 7): region, accepted patches, votes and pose."""
    region = read_regions(detection.regions().folder, frame)[object_id]
    context = detection.estimator.prepare(frame)
    coarse = detection.estimator.find_hypotheses(context, region)
    voters = sorted(set(coarse.votes.patches.tolist()))
    return draw_panels(
        frame,
        detection.dataset.models[object_id],
        region,
        coarse.patches.pixels[voters],
        coarse.votes,
        estimate,
        truth,
    )
