"""What known objects, found in some frames or not, tell of faults of these frames.

Where an object is found, its pose is followed by the refiner alone to where it is seen after each
correction, and its colours are compared with the image's. Where none is found, the correction after
which it is found with certainty is named. `FaultWatch` looks at the first frames of `hlp predict`.
"""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from hlp.arrays import Mask, Pose
from hlp.checks import Finding
from hlp.checks.corrections import EXCHANGED, ROWS, UNITS, Correction, check_gains
from hlp.checks.frame_checks import check_depth_scale, check_first_frame
from hlp.checks.registration import check_registration, find_registration
from hlp.errors import InputError
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection, SearchResult, TrackingResult
from hlp.records import Frame, ObjectModel
from hlp.refinement.score_model import MIN_SCORE
from hlp.refinement.texture import color_agreement
from hlp.refinement.verification import VerificationSettings, observe

_CERTAIN = 0.8  # score of the answer, or of that after the correction; absent objects seldom reach
_CERTAIN_ALONE = 0.9  # the same for a correction where there is no second frame
_FOUND = 0.6  # a score that needs no explanation
_SCORE_GAIN, _COLOR_GAIN = 0.3, 0.15  # that a correction must bring; colours are a small part of it
_SHAPE_FITS = 0.8  # agreement of depth steps and of slopes: wrong poses rarely reach it
_LIKELY = 5.0  # agreement of the edges at a place of depth that the objects are to confirm
_CONFIRMING = 3  # frames of a search, the first one among them
_SOUGHT = 3  # objects that are looked for after each correction
ABSENT = "objects"
"""The kind of a finding that objects are found nowhere."""


def known_gains(
    detector: Detector, frame: Frame, answers: Sequence[Detection]
) -> dict[Correction, float]:
    """How much less the most certain answer to a frame costs after each correction.

    A correction is left out if the pose is uncertain before and after it: the cost of a wrong pose
    says nothing. Beside them is the gain of colours, at all poses whose shape fits. It takes a
    quarter of a second.
    """
    models = detector.models
    fitting = [a for a in answers if min(a.fit.depth_correlation, a.fit.slope) >= _SHAPE_FITS]
    gains = exchange_gain(frame, [(models[a.object], a.pose_cam_obj) for a in fitting])
    best = max(answers, key=lambda answer: answer.score, default=None)
    if best is None:
        return gains
    for row in ROWS:
        gain, score = np.inf, 0.0
        for correction in row:
            if gain > 0.0:  # a larger one is tried only where the smaller one helps
                pose = correction.pose(best.pose_cam_obj, models[best.object].centroid)
                there = correction.frame(frame)
                image, found = (there.rgb, there.depth, there.camera_matrix), None
                with suppress(InputError):  # of a correction that makes no sense for this frame
                    found = detector.refine(*image, best.object, pose)
                if found is None:
                    break
                gain, score = best.fit.cost - found.fit.cost, found.score
            if max(score, best.score) >= _CERTAIN:
                gains[correction] = gain
    return gains


def exchange_gain(
    frame: Frame, placed: Sequence[tuple[ObjectModel, Pose]]
) -> dict[Correction, float]:
    """How much better the colours of objects agree with red and blue exchanged.

    The mean difference of the correlations at the poses of those with colours; empty if none has.
    """
    stated = observe(frame.rgb, frame.depth, frame.camera_matrix, VerificationSettings())
    exchanged = replace(stated, rgb=EXCHANGED.frame(frame).rgb)
    colored = [(model, pose) for model, pose in placed if model.mesh.colored]
    before, after = (
        [color_agreement(seen, *each).correlation for each in colored]
        for seen in (stated, exchanged)
    )
    return {EXCHANGED: float(np.mean(np.subtract(after, before)))} if colored else {}


def all_answers(found: SearchResult | TrackingResult) -> list[Detection]:
    """Detections and what was not good enough: a fault of the frame lowers the score."""
    rejected = [rejection.answer for rejection in found.rejections if rejection.answer]
    return [*found.detections, *rejected]


def find_answers(
    detector: Detector, objects: Sequence[str], masks: Mapping[str, Mask], frame: Frame
) -> list[Detection]:
    """The best answer for each of the objects in a frame, whatever its score.

    None where a frame makes no sense. `masks` are by the keys of frames; one without is searched
    everywhere.
    """
    if check_depth_scale(frame, [detector.models[name] for name in objects]):
        return []  # objects of no size that could be found, and slow to look for
    images, mask = (frame.rgb, frame.depth, frame.camera_matrix), masks.get(frame.key)
    with suppress(InputError):
        return all_answers(detector.search(*images, objects, 1, 0.0, mask))
    return []


def check_by_search(
    frames: Sequence[Frame], stated: float, find_best: Callable[[Frame], float], unit: float | None
) -> list[Finding]:
    """The fault that keeps objects from being found in the first of some frames.

    `stated` is the best score there, `find_best` gives that of any learnt object in a frame, `unit`
    is how many mm a unit of depth was taken for. Objects must then be found in one of the two next
    frames too, and more certainly if there is none: something may look like an absent object after
    some correction. It takes 20 to 40 searches.
    """
    frame, others = frames[0], frames[1:_CONFIRMING]
    certain = _CERTAIN if others else _CERTAIN_ALONE

    def named(rows: Sequence[tuple[Correction, ...]], gain: float) -> list[Finding]:
        scores = {each: find_best(each.frame(frame)) for row in rows for each in row}
        best = max(scores, key=lambda each: scores[each])
        if scores[best] < max(certain, stated + gain):
            return []
        # Another factor of the row may suit the other frame better.
        row = sorted(next(row for row in rows if best in row), key=lambda each: each != best)
        tried = (find_best(each.frame(other)) for other in others for each in row)
        if others and not any(score >= _CERTAIN for score in tried):
            return []
        because = f"objects are found then with a score of {scores[best]:.2f}, not {stated:.2f}"
        place = best.registration
        found = [] if place is None else [place.finding(frame, because)]
        if place is None or best.depth != 1.0:
            found.append(best.finding(f"frame {frame.key}", because, unit))
        return found

    found = named([(EXCHANGED,)], _COLOR_GAIN)
    if found or stated >= _FOUND:
        return found
    place = find_registration(frames, whole=True, clear=_LIKELY)
    factors = () if place is None else (1.0, *UNITS)
    placed = tuple(Correction(depth=factor, registration=place) for factor in factors)
    return named([placed, *ROWS], _SCORE_GAIN)


def check_with_objects(
    detector: Detector, frames: Sequence[Frame], masks: Mapping[str, Mask], unit: float | None
) -> list[Finding]:
    """Faults that keep objects from being found, or with which they fit worse in most frames."""
    answers = [find_answers(detector, detector.objects, masks, frame) for frame in frames]
    found = [answer for each in answers for answer in each]
    scores = {name: _best(a for a in found if a.object == name) for name in detector.objects}
    sought = sorted(scores, key=lambda name: -scores[name])[:_SOUGHT]
    best = [_best(each) for each in answers]
    likely = [frames[place] for place in np.argsort(best)[::-1]]
    findings = check_by_search(
        likely, max(best), lambda frame: _best(find_answers(detector, sought, masks, frame)), unit
    )
    both = zip(frames, answers, strict=True)
    findings = findings or check_gains([known_gains(detector, *each) for each in both])
    absent = [name for name in scores if scores[name] < MIN_SCORE]
    if findings or not absent:
        return findings
    advice = "It is not in view or too small, or depth is not registered to colour"
    return [Finding(ABSENT, ", ".join(absent), f"found in none of {len(frames)} frames", advice)]


def _best(answers: Iterable[Detection]) -> float:
    """The highest score; 0 where there is none."""
    return max((answer.score for answer in answers), default=0.0)


_EXAMINED = 6  # frames
_logger = logging.getLogger(__name__)


class FaultWatch:
    """Examines the first frames of a call, after their answers were written.

    Says one fault at most. Units and intrinsics are looked at in the first frame, what needs known
    objects in the first six together. Where none is found in them, it says so: the reason is looked
    for by `hlp doctor`, which takes longer.
    """

    def __init__(self, detector: Detector, objects: Sequence[str] | None) -> None:
        """`objects` are the names that are looked for, None: all learnt ones."""
        self._detector, self._names = detector, objects or detector.objects
        self._seen: list[tuple[Frame, list[Detection]]] = []
        self._done = False

    def add(self, frame: Frame, found: SearchResult | TrackingResult) -> None:
        """Take in the next frame and what was found in it; warn of what is noticed."""
        if self._done:
            return
        self._seen.append((frame, all_answers(found)))
        if len(self._seen) == 1:
            models = [self._detector.models[name] for name in self._names]
            self._say(check_first_frame(frame, models))
        if len(self._seen) == _EXAMINED:
            self.end()

    def end(self) -> None:
        """Say what the frames tell after the last one."""
        if self._done or not self._seen:
            return
        found = check_gains([known_gains(self._detector, *each) for each in self._seen])
        self._say(found or check_registration([frame for frame, _ in self._seen]))
        if not any(found.score >= MIN_SCORE for _, answers in self._seen for found in answers):
            _logger.info(
                "%s: found in none of %d frames. Less than 40 px along the diameter are too few; "
                "`hlp doctor` with the same learnt, rgb, depth, intrinsics, mask and box looks for "
                "other reasons",
                ", ".join(self._names),
                len(self._seen),
            )
        self._done = True
        self._seen.clear()

    def _say(self, findings: Sequence[Finding]) -> None:
        for finding in findings:
            _logger.warning("warning: %s", finding)
        self._done = bool(findings)
