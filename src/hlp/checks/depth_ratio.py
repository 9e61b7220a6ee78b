"""Whether depth is a tenth too small or too large: known objects then fit better after a change.

An object of known size that is seen a tenth too near is drawn a tenth too large. Where it is found
nonetheless, its pose costs more than after depth is corrected, by little but in nearly every frame.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hlp.checks.finding import Finding
from hlp.method.detections import Detection
from hlp.records import Frame

FindAnswers = Callable[[Frame], Sequence[Detection]]
"""The best answer for each object in a frame, whatever its score."""

_FACTORS = (0.9, 1.0 / 0.9)
_CERTAIN = 0.8  # score of an answer after the change
_FEWEST = 3  # frames
# Of the verification cost, which a change raises in most healthy frames.
_CLEAR = 0.015
_SHARE = 0.75  # of the frames that must say the same


def ratio_gains(
    frame: Frame, answers: Sequence[Detection], find: FindAnswers
) -> dict[float, float]:
    """How much less known objects cost with depth times a factor, by the factor.

    `answers` are those of `find` in the frame itself. Only objects that are found with certainty
    after the change count; a factor after which there is none is left out.
    """
    costs = {each.object: each.fit.cost for each in answers}
    gains = {}
    for factor in _FACTORS:
        changed = find(replace(frame, depth=(frame.depth * factor).astype(np.float32)))
        found = [
            costs[each.object] - each.fit.cost
            for each in changed
            if each.score >= _CERTAIN and each.object in costs
        ]
        if found:
            gains[factor] = float(np.mean(found))
    return gains


def check_depth_ratio(gains: Sequence[Mapping[float, float]]) -> list[Finding]:
    """Depth that is a tenth off, if most of at least three frames say so clearly.

    `gains` are those of `ratio_gains`, one for each frame.
    """
    for factor in _FACTORS:
        found = [each[factor] for each in gains if factor in each]
        agreeing = sum(gain > 0.0 for gain in found)
        if len(found) < _FEWEST or np.median(found) < _CLEAR or agreeing < _SHARE * len(found):
            continue
        return [
            Finding(
                "depth scale",
                f"{agreeing} of {len(found)} frames",
                f"depth may be {1.0 / factor:.2g} times what it should be, or the mesh "
                f"{factor:.2g} times as large as the object: known objects fit better when depth "
                f"is corrected (cost lower by {np.median(found):.3f})",
                "Check depth_scale and mesh_scale",
            )
        ]
    return []
