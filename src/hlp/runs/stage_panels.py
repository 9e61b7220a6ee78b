"""The results of all stages for one object in one frame, as one picture."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8

from hlp.config.build import Run, evenly
from hlp.records import Frame, ObjectModel, Target
from hlp.refinement.score_model import ScoreModel
from hlp.reporting.figures.panels import draw_panels
from hlp.stages.frame_detection import estimates_of
from hlp.stages.frame_results import Arrays, regions_of, votes_of


def drawn_frames(run: Run) -> tuple[str, ...]:
    """Keys of the frames whose panels are drawn: `panels` of the run's, spread evenly."""
    return evenly(run.keys, run.settings.panels) if run.settings.panels > 0 else ()


def picture_of_stages(
    frame: Frame,
    found: Mapping[str, Arrays],
    model: ObjectModel,
    scores: Mapping[int, ScoreModel],
    truth: Target | None,
) -> UInt8[np.ndarray, "_ _ 3"]:
    """The paper's four panels (Fig. 7) of an object: region, accepted patches, votes and pose.

    `found` holds the arrays of each stage in that frame, `scores` the objects' score models.
    """
    object_id = model.object_id
    estimates = estimates_of(frame.key, found["poses"], {}, scores)
    best = {each.object_id: each for each in sorted(estimates, key=lambda item: item.score)}
    return draw_panels(
        frame,
        model,
        regions_of(found["regions"], (frame.depth.shape[0], frame.depth.shape[1]))[object_id],
        votes_of(found["hypotheses"], object_id),
        best.get(object_id),
        truth,
    )
