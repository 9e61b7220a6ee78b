"""Whether red and blue are exchanged: known objects agree better with the image's colours then.

At each pose whose shape fits, the object's colours are compared with the image's in both orders.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hlp.checks.finding import Finding, counted
from hlp.checks.registration import colored_answers
from hlp.method.find.detections import Detection
from hlp.records import Frame, ObjectModel
from hlp.refinement.texture import color_agreement
from hlp.refinement.verification import VerificationSettings, observe

_FEWEST = 3  # frames
# Difference of both correlations. Objects of nearly no colour have one of about 0 either way.
_CLEAR = 0.4
_SHARE = 0.75  # of the frames that must say the same
_CLEAR_ALONE = 0.8  # of one or two frames; objects of much colour have differences above 1


def exchange_gain(
    frame: Frame, models: Mapping[str, ObjectModel], answers: Sequence[Detection]
) -> float | None:
    """How much better the colours of known objects agree with red and blue exchanged.

    The mean difference of the correlations at the poses whose shape fits; None if there is no such
    pose of an object with colours. `models` are by the names of the answers.
    """
    fitting = colored_answers(models, answers)
    if not fitting:
        return None
    stated = observe(frame.rgb, frame.depth, frame.camera_matrix, VerificationSettings())
    exchanged = replace(stated, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))
    gains = []
    for each in fitting:
        one, other = (
            color_agreement(seen, models[each.object], each.pose_cam_obj).correlation
            for seen in (stated, exchanged)
        )
        gains.append(other - one)
    return float(np.mean(gains))


def check_color_order(gains: Sequence[float | None]) -> list[Finding]:
    """Exchanged red and blue, if most of at least three frames say so clearly.

    Two frames, or the only one, must say so more clearly. `gains` are those of `exchange_gain`, one
    for each frame.
    """
    told = [each for each in gains if each is not None]
    if not told or len(told) < min(len(gains), 2):
        return []
    agreeing = sum(gain > 0.0 for gain in told)
    if len(told) < _FEWEST:
        exchanged = min(told) >= _CLEAR_ALONE
    else:
        exchanged = float(np.mean(told)) >= _CLEAR and agreeing >= _SHARE * len(told)
    if not exchanged:
        return []
    return [
        Finding(
            "colours",
            counted(agreeing),
            "known objects agree better with red and blue exchanged (correlation of colours "
            f"higher by {np.mean(told):.2f})",
            "OpenCV reads blue first: write RGB",
        )
    ]
