"""What known objects, found in some frames, tell of faults of these frames."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hlp.checks.color_order import check_color_order, exchange_gain
from hlp.checks.color_shift import check_color_shift, shift_agreements
from hlp.checks.depth_and_focal import CorrectedFits, check_corrections, correction_gains
from hlp.checks.finding import Finding
from hlp.errors import InputError
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection
from hlp.records import Frame


class Evidence:
    """Order and shift of colours, unit of depth, focal lengths: a quarter of a second a frame."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._exchanges: list[float | None] = []
        self._shifts: list[Float[np.ndarray, "s s"] | None] = []
        self._fits: list[CorrectedFits] = []

    def add(self, frame: Frame, answers: Sequence[Detection]) -> None:
        """Take in a frame and the answers to it, whatever their score."""
        models = self._detector.models
        self._exchanges.append(exchange_gain(frame, models, answers))
        self._shifts.append(shift_agreements(frame, models, answers))
        self._fits.append(correction_gains(frame, models, answers, self._refine))

    def findings(self) -> list[Finding]:
        """What is wrong with these frames, one fault at most: one disturbs the signs of others."""
        checks = (
            check_color_order(self._exchanges),
            check_color_shift(self._shifts),
            check_corrections(self._fits),
        )
        return next((found for found in checks if found), [])

    def _refine(self, frame: Frame, answer: Detection) -> Detection | None:
        try:
            return self._detector.refine(
                frame.rgb, frame.depth, frame.camera_matrix, answer.object, answer.pose_cam_obj
            )
        except InputError:  # a correction that makes no sense for this frame
            return None
