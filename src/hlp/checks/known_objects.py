"""What known objects, found in some frames, tell of faults of these frames.

At each pose whose shape fits, the object's colours are compared with the image's: with red and blue
as they are and exchanged. Depth and focal lengths are judged by `hlp.checks.corrections`. Three
frames must show a fault; one or two, more clearly. `FaultWatch` does so for the first frames of
`hlp predict`.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hlp.arrays import Pose
from hlp.checks import Finding, counted
from hlp.checks.corrections import (
    Correction,
    all_answers,
    check_corrections,
    correction_gains,
)
from hlp.checks.frame_checks import check_first_frame, check_registration
from hlp.errors import InputError
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection, SearchResult, TrackingResult
from hlp.records import Frame, ObjectModel
from hlp.refinement.score_model import MIN_SCORE
from hlp.refinement.texture import color_agreement
from hlp.refinement.verification import VerificationSettings, observe

_SHAPE_FITS = 0.8  # agreement of depth steps and of slopes: wrong poses rarely reach it
_ENOUGH = 3  # frames
_SHARE = 0.75  # of the frames that must say the same
# Red and blue exchanged: difference of both correlations. Objects of nearly no colour have one of
# about 0 either way, objects of much colour above 1.
_EXCHANGED, _EXCHANGED_ALONE = 0.4, 0.8


class Evidence:
    """Order of colours, unit of depth, focal lengths: a quarter of a second a frame."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._exchanges: list[float | None] = []
        self._fits: list[dict[Correction, float]] = []

    def add(self, frame: Frame, answers: Sequence[Detection]) -> None:
        """Take in a frame and the answers to it, whatever their score."""
        models = self._detector.models
        fitting = colored_answers(models, answers)
        placed = [(models[answer.object], answer.pose_cam_obj) for answer in fitting]
        self._exchanges.append(exchange_gain(frame, placed))
        self._fits.append(correction_gains(frame, models, answers, self._refine))

    def findings(self) -> list[Finding]:
        """What is wrong with these frames, one fault at most: one disturbs the signs of others."""
        return check_color_order(self._exchanges) or check_corrections(self._fits)

    def _refine(self, frame: Frame, answer: Detection) -> Detection | None:
        try:
            return self._detector.refine(
                frame.rgb, frame.depth, frame.camera_matrix, answer.object, answer.pose_cam_obj
            )
        except InputError:  # a correction that makes no sense for this frame
            return None


def colored_answers(
    models: Mapping[str, ObjectModel], answers: Sequence[Detection]
) -> list[Detection]:
    """Poses of objects with colours whose shape fits. `models` are by the names of the answers."""
    return [
        answer
        for answer in answers
        if models[answer.object].mesh.colored
        and min(answer.fit.depth_correlation, answer.fit.slope) >= _SHAPE_FITS
    ]


def exchange_gain(frame: Frame, placed: Sequence[tuple[ObjectModel, Pose]]) -> float | None:
    """How much better the colours of objects agree with red and blue exchanged.

    The mean difference of the correlations at the poses of those with colours; None if none has.
    """
    stated = observe(frame.rgb, frame.depth, frame.camera_matrix, VerificationSettings())
    exchanged = replace(stated, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))
    gains = [
        color_agreement(exchanged, model, pose).correlation
        - color_agreement(stated, model, pose).correlation
        for model, pose in placed
        if model.mesh.colored
    ]
    return float(np.mean(gains)) if gains else None


def check_color_order(gains: Sequence[float | None]) -> list[Finding]:
    """Exchanged red and blue, by the `exchange_gain` of each frame."""
    known = [gain for gain in gains if gain is not None]
    if not known or len(known) < min(len(gains), 2):
        return []
    agreeing = sum(gain > 0.0 for gain in known)
    if len(known) < _ENOUGH:
        exchanged = min(known) >= _EXCHANGED_ALONE
    else:
        exchanged = float(np.mean(known)) >= _EXCHANGED and agreeing >= _SHARE * len(known)
    if not exchanged:
        return []
    problem = (
        "known objects agree better with red and blue exchanged (correlation of colours higher by "
        f"{np.mean(known):.2f})"
    )
    advice = "OpenCV reads blue first: write RGB"
    return [Finding("colours", counted(agreeing), problem, advice)]


_EXAMINED = 6  # frames
_SURE = 3  # frames before the first examination
_logger = logging.getLogger(__name__)


class FaultWatch:
    """Examines the first frames of a call, each after its answers were written.

    Says one fault at most. Units and intrinsics are looked at in the first frame, what needs known
    objects in the first six; one or two frames must show it more clearly. Where none is found in
    them, it says so: the reason is looked for by `hlp doctor`, which takes longer.
    """

    def __init__(self, detector: Detector, objects: Sequence[str] | None) -> None:
        """`objects` are the names that are looked for, None: all learnt ones."""
        self._detector, self._names = detector, objects or detector.objects
        self._evidence = Evidence(detector)
        self._frames: list[Frame] = []
        self._answers: list[list[Detection]] = []
        self._done = False

    def add(self, frame: Frame, found: SearchResult | TrackingResult) -> None:
        """Take in the next frame and what was found in it; warn of what is noticed."""
        if self._done:
            return
        self._frames.append(frame)
        self._answers.append(all_answers(found))
        count = len(self._frames)
        if count == 1:
            models = [self._detector.models[name] for name in self._names]
            self._say(check_first_frame(frame, models))
        if count >= _SURE:  # fewer are examined at the end: more frames make it surer
            self._examine(0 if count == _SURE else count - 1)
        if count == _EXAMINED:
            self.end()

    def end(self) -> None:
        """Say what the frames tell after the last one."""
        if self._done or not self._frames:
            return
        count = len(self._frames)
        if count < _SURE:
            self._examine(0)
        self._say(check_registration(self._frames))
        if all(found.score < MIN_SCORE for answers in self._answers for found in answers):
            _logger.info(
                "%s: found in none of %d frames; `hlp doctor` with the same learnt, rgb, depth, "
                "intrinsics, mask and box looks for the reason",
                ", ".join(self._names),
                count,
            )
        self._done = True
        self._frames.clear()

    def _examine(self, first: int) -> None:
        for frame, answers in zip(self._frames[first:], self._answers[first:], strict=True):
            self._evidence.add(frame, answers)
        self._say(self._evidence.findings())

    def _say(self, findings: Sequence[Finding]) -> None:
        if not self._done:
            for finding in findings:
                _logger.warning("warning: %s", finding)
            self._done = bool(findings)
