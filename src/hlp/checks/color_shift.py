"""Whether colour is shifted against depth: known objects show it, at the poses that fit depth.

The object's colours are compared with the image's, which are moved by every one of some shifts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from hlp.checks.finding import Finding, counted
from hlp.checks.registration import colored_answers
from hlp.method.find.detections import Detection
from hlp.records import Frame, ObjectModel
from hlp.refinement.texture import color_agreement
from hlp.refinement.verification import VerificationSettings, observe

_SHIFTS = (-10, -5, 0, 5, 10)  # px, in both directions
_CERTAIN = 0.8  # score: at a wrong pose some shift always agrees better
_FEWEST = 3  # frames
_CLEAR = 0.04  # correlation that the best shift must bring
_TOLERATED = 6.0  # px; cameras that claim to be registered are up to 5 off
# The same where there are only one or two frames:
_CLEAR_ALONE = 0.05
_TOLERATED_ALONE = 8.0


def shift_agreements(
    frame: Frame, models: Mapping[str, ObjectModel], answers: Sequence[Detection]
) -> Float[np.ndarray, "s s"] | None:
    """How well the colours of the most certain object agree with the image's, by their shift.

    Rows are shifts of depth downwards, columns to the right. None if no object with colours is
    certain. `models` are by the names of the answers.
    """
    best = max(colored_answers(models, answers), key=lambda each: each.score, default=None)
    if best is None or best.score < _CERTAIN:
        return None
    seen = observe(frame.rgb, frame.depth, frame.camera_matrix, VerificationSettings())

    def agreement(down: int, right: int) -> float:
        moved = replace(seen, rgb=np.roll(frame.rgb, (-down, -right), axis=(0, 1)))
        return color_agreement(moved, models[best.object], best.pose_cam_obj).correlation

    return np.array([[agreement(down, right) for right in _SHIFTS] for down in _SHIFTS])


def check_color_shift(agreements: Sequence[Float[np.ndarray, "s s"] | None]) -> list[Finding]:
    """Colour shifted against depth, if known objects in at least three frames say so clearly.

    Two frames, or the only one, must say so more clearly. `agreements` are those of
    `shift_agreements`, one for each frame.
    """
    told = [each for each in agreements if each is not None]
    if not told or len(told) < min(len(agreements), 2):
        return []
    mean = np.mean(told, axis=0)
    row, column = np.unravel_index(int(mean.argmax()), mean.shape)
    right, down = _SHIFTS[column], _SHIFTS[row]
    middle = len(_SHIFTS) // 2
    gain = mean[row, column] - mean[middle, middle]
    few = len(told) < _FEWEST
    tolerated, clear = (_TOLERATED_ALONE, _CLEAR_ALONE) if few else (_TOLERATED, _CLEAR)
    if np.hypot(right, down) < tolerated or gain < clear:
        return []
    return [
        Finding(
            "registration",
            counted(len(told)),
            f"the colours of known objects agree better when depth is moved by about ({right}, "
            f"{down}) px (correlation higher by {gain:.2f})",
            "Register depth to colour: take the camera's aligned depth stream",
        )
    ]
