"""Whether depth, focal lengths or colours are wrong: known objects fit better after a correction.

An object that is seen a tenth too near, or by a focal length that is too long, is drawn too large.
Where it is found nonetheless, its pose costs more than after the correction, in nearly every frame;
from the pose that it was found at it is followed by the refiner alone. Where it is not found,
units and place of depth, focal length and colours are changed in turn, and the change after which
it is found with certainty is named.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hlp.arrays import Mask, Point, Pose
from hlp.checks import Finding, counted
from hlp.checks.frame_checks import Registration, check_depth_scale, find_registration
from hlp.errors import InputError
from hlp.geometry import transform
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection, SearchResult, TrackingResult
from hlp.records import Frame, ObjectModel

Refine = Callable[[Frame, Detection], Detection | None]
"""The best pose of an object about where an answer says that it is in a frame."""
FindBest = Callable[[Frame], float]
"""The highest score of any learnt object in a frame."""

_CERTAIN = 0.8  # score of the answer, or of that after the correction; absent objects seldom reach
_CERTAIN_ALONE = 0.9  # the same for a change where there is no second frame
_FOUND = 0.6  # a score that needs no explanation
_SCORE_GAIN, _COLOR_GAIN = 0.3, 0.15  # that a change must bring; colours are a small part of it
_CLEAR = 0.035  # of the verification cost, which a correction raises in most healthy frames
_ENOUGH = 3  # frames that must say the same
_SHARE = 0.75  # of the frames that must say the same
_LIKELY = 5.0  # agreement of the edges at a place of depth that the objects are to confirm
_CONFIRMING = 3  # frames of a search, the first one among them
# Of one or two frames each must say it more clearly: where the object is mostly hidden, or is no
# such object, a pose may fit better by chance.
_CLEAR_ALONE = 0.06


@dataclass(frozen=True)
class Correction:
    """Factors of the depth image and of both focal lengths, and where depth lies in the colours."""

    depth: float = 1.0
    focal: float = 1.0
    registration: Registration | None = None

    def frame(self, frame: Frame) -> Frame:
        """The frame as it would be without the fault."""
        if self.registration is not None:
            frame = self.registration.frame(frame)
        matrix = frame.camera_matrix.copy()
        matrix[[0, 1], [0, 1]] *= self.focal
        depth = (frame.depth * self.depth).astype(np.float32)
        return replace(frame, depth=depth, camera_matrix=matrix)

    def pose(self, pose_cam_obj: Pose, centroid: Point) -> Pose:
        """A pose of which the object's centroid is where the corrected frame shows it."""
        seen = transform(pose_cam_obj, centroid[None])[0]
        moved = seen * self.depth * np.array([1.0 / self.focal, 1.0 / self.focal, 1.0])
        corrected = pose_cam_obj.copy()
        corrected[:3, 3] += moved - seen
        return corrected

    def findings(self, where: str, because: str, unit: float | None, frame: Frame) -> list[Finding]:
        """The faults that it corrects in a frame read with so many mm per unit of depth."""
        found = [] if self.registration is None else [self.registration.finding(frame, because)]
        if self.depth != 1.0 or self.registration is None:
            found.append(self.finding(where, because, unit))
        return found

    def finding(self, where: str, because: str, unit: float | None = None) -> Finding:
        """The wrong factor that it corrects; `because` says what is better without it."""
        if self.depth == 1.0:
            problem = f"the focal length may be {1 / self.focal:.2g} times what it should be"
            advice = "Check fx and fy: are they those of images of another size?"
            return Finding("intrinsics", where, f"{problem}: {because}", advice)
        if self.depth in _UNITS and unit is not None:
            problem = f"depth may be in units of {unit * self.depth:g} mm, not {unit:g}"
            advice = f"Give depth_scale={unit * self.depth:g}"
            return Finding("depth scale", where, f"{problem}: {because}", advice)
        problem = (
            f"depth may be {1 / self.depth:.2g} times what it should be, or the mesh "
            f"{self.depth:.2g} times as large as the object"
        )
        advice = "Check depth_scale and mesh_scale"
        return Finding("depth scale", where, f"{problem}: {because}", advice)


# Of poses: each row from small to large; a larger one is tried only where the smaller one helps.
_CORRECTIONS = (
    (Correction(depth=0.9),),
    (Correction(depth=1.0 / 0.9),),
    (Correction(focal=1.33), Correction(focal=1.5), Correction(focal=2.0)),
    (Correction(focal=0.77), Correction(focal=0.67), Correction(focal=0.53)),
)
_UNITS = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""Units of depth that cameras have, 1/8 mm to 1 mm, in each other."""
# Of searches: a fault lies between two of a row's factors.
_CHANGES = (
    tuple(Correction(depth=factor) for factor in (0.1, 0.125, 0.25, 0.5, 0.9)),
    tuple(Correction(depth=factor) for factor in (1.1, 2.0, 4.0, 8.0, 10.0)),
    (Correction(focal=0.53), Correction(focal=0.67), Correction(focal=0.8)),
    (Correction(focal=1.25), Correction(focal=1.5), Correction(focal=2.0)),
)


def correction_gains(
    frame: Frame, models: Mapping[str, ObjectModel], answers: Sequence[Detection], refine: Refine
) -> dict[Correction, float]:
    """How much less the most certain answer to a frame costs after each correction.

    A correction is left out if the pose is uncertain before and after it: the cost of a wrong pose
    says nothing. `models` are by the names of the answers.
    """
    best = max(answers, key=lambda answer: answer.score, default=None)
    gains = dict[Correction, float]()
    if best is None:
        return gains
    for row in _CORRECTIONS:
        gain, score = np.inf, 0.0
        for correction in row:
            if gain > 0.0:
                pose = correction.pose(best.pose_cam_obj, models[best.object].centroid)
                found = refine(correction.frame(frame), replace(best, pose_cam_obj=pose))
                if found is None:
                    break
                gain, score = best.fit.cost - found.fit.cost, found.score
            if max(score, best.score) >= _CERTAIN:
                gains[correction] = gain
    return gains


def check_corrections(fits: Sequence[Mapping[Correction, float]]) -> list[Finding]:
    """The fault whose correction helps most.

    Most of at least three frames must say so; both of two, or the only one, more clearly. `fits`
    are those of `correction_gains`, one for each frame.
    """
    clear = dict[Correction, float]()
    for correction in (correction for row in _CORRECTIONS for correction in row):
        known = [fit for fit in fits if correction in fit]
        if known and len(known) >= min(len(fits), 2) and _helps(correction, known):
            clear[correction] = float(np.median([fit[correction] for fit in known]))
    best = max(clear, key=lambda correction: clear[correction], default=None)
    if best is None or clear[best] < _CLEAR:
        return []
    count = sum(best in fit for fit in fits)
    gain = f"known objects fit better when it is corrected (cost lower by {clear[best]:.3f})"
    return [best.finding(counted(count), gain)]


def _helps(correction: Correction, fits: Sequence[Mapping[Correction, float]]) -> bool:
    gains = [fit[correction] for fit in fits]
    if len(gains) < _ENOUGH:
        return min(gains) >= _CLEAR_ALONE
    return sum(gain > 0.0 for gain in gains) >= _SHARE * len(gains)


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
    try:
        return all_answers(detector.search(*images, objects, 1, 0.0, mask))
    except InputError:
        return []


def check_by_search(
    frames: Sequence[Frame], stated: float, find_best: FindBest, unit: float | None = None
) -> list[Finding]:
    """The fault that keeps objects from being found in the first of some frames.

    `stated` is the best score there, `unit` how many mm a unit of depth was taken for. Objects must
    then be found in one of the two next frames too, and more certainly if there is none: something
    may look like an absent object after some change. It takes 20 to 40 searches.
    """
    if not frames:
        return []
    frame, others = frames[0], frames[1:_CONFIRMING]
    certain = _CERTAIN if others else _CERTAIN_ALONE
    where = f"frame {frame.key}"

    def confirmed(changes: Sequence[Callable[[Frame], Frame]]) -> bool:
        tried = (find_best(change(other)) for other in others for change in changes)
        return not others or any(score >= _CERTAIN for score in tried)

    def gain(score: float) -> str:
        return f"objects are found then with a score of {score:.2f}, not {stated:.2f}"

    swapped = find_best(_swapped(frame))
    if swapped >= max(certain, stated + _COLOR_GAIN) and confirmed([_swapped]):
        problem = f"red and blue may be exchanged: {gain(swapped)}"
        return [Finding("colours", where, problem, "OpenCV reads blue first: write RGB")]
    if stated >= _FOUND:
        return []
    place = find_registration(frames, whole=True, clear=_LIKELY)
    factors = () if place is None else (1.0, *_UNITS)
    placed = tuple(Correction(depth=factor, registration=place) for factor in factors)
    changes = (placed, *_CHANGES)
    scores = {change: find_best(change.frame(frame)) for row in changes for change in row}
    best = max(scores, key=lambda change: scores[change])
    # Another factor of the row may suit the other frame better.
    alike = next(row for row in changes if best in row)
    alike_first = [change.frame for change in sorted(alike, key=lambda change: change != best)]
    if scores[best] >= max(certain, stated + _SCORE_GAIN) and confirmed(alike_first):
        return best.findings(where, gain(scores[best]), unit, frame)
    return []


def _swapped(frame: Frame) -> Frame:
    return replace(frame, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))
