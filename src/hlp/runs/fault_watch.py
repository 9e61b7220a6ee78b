"""What `hlp predict` notices in its first frames: faults of the files that cost right poses."""

import logging
from collections.abc import Sequence
from functools import partial

from hlp.checks import Finding
from hlp.checks.corrections import best_score, check_by_search
from hlp.checks.frame_checks import check_first_frame, check_registration
from hlp.checks.known_objects import Evidence, all_answers
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection, SearchResult, TrackingResult
from hlp.records import Frame
from hlp.refinement.score_model import MIN_SCORE

_EXAMINED = 6  # frames
_SURE = 3  # frames before the first examination, and without answers before the search
_logger = logging.getLogger(__name__)


class FaultWatch:
    """Examines the first frames of a call, each after its answers were written.

    Says one fault at most. Units and intrinsics are looked at in the first frame, what needs known
    objects in the first six; one or two frames must show it more clearly. Where none is found in
    them, one frame is searched with other units, focal lengths and colours.
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
        scores = [max((found.score for found in answers), default=0.0) for answers in self._answers]
        missed = [place for place, score in enumerate(scores) if score < MIN_SCORE]
        if not self._done and len(missed) >= max(min(_SURE, count), (count + 1) // 2):
            missed.sort(key=lambda place: -scores[place])
            self._search(missed, scores[missed[0]])
        if count >= _SURE:
            self._say(check_registration(self._frames))
        if not self._done and len(missed) == count:
            _logger.info(
                "nothing was found; `hlp doctor` with the same learnt, rgb, depth and intrinsics "
                "looks for the reason"
            )
        self._done = True
        self._frames.clear()

    def _examine(self, first: int) -> None:
        for frame, answers in zip(self._frames[first:], self._answers[first:], strict=True):
            self._evidence.add(frame, answers)
        self._say(self._evidence.findings())

    def _search(self, missed: Sequence[int], stated: float) -> None:
        """What change of frames lets the object be found that fits the first of them best."""
        best = max(self._answers[missed[0]], key=lambda found: found.score, default=None)
        name = self._names[0] if best is None else best.object
        where = "in most frames" if len(self._frames) > 1 else "in this frame"
        _logger.info(
            "%s is not found %s: trying other units, focal lengths and colours", name, where
        )
        find = partial(best_score, self._detector, objects=[name])
        self._say(check_by_search([self._frames[place] for place in missed], stated, find))

    def _say(self, findings: Sequence[Finding]) -> None:
        if not self._done:
            for finding in findings:
                _logger.warning("warning: %s", finding)
            self._done = bool(findings)
