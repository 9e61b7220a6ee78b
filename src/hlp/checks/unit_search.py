"""Whether learnt objects are found, or only after a fault is undone.

For frames without true poses: depth, focal length and colours are changed in turn, and the change
after which an object is found with certainty is named.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hlp.checks.depth_and_focal import Correction
from hlp.checks.finding import Finding
from hlp.checks.frame_checks import check_depth_scale
from hlp.errors import InputError
from hlp.method.detector import Detector
from hlp.records import Frame

FindBest = Callable[[Frame], float]
"""The highest score of any learnt object in a frame."""

_FOUND = 0.6  # a score that needs no explanation
_CERTAIN = 0.8  # a score that explains why there was none: absent objects seldom reach it
_CERTAIN_ALONE = 0.9  # the same where there is no second frame
_GAIN = 0.3  # that undoing a fault must bring
_COLOR_GAIN = 0.15  # colours are a small part of the score
_CHANGES = tuple(
    tuple(Correction(**{name: factor}) for factor in factors)
    for name, factors in (
        ("depth", (0.1, 0.5, 0.9)),
        ("depth", (1.1, 2.0, 10.0)),
        ("focal", (0.53, 0.67, 0.8)),
        ("focal", (1.25, 1.5, 2.0)),
    )
)


def best_score(detector: Detector, frame: Frame, objects: Sequence[str] | None = None) -> float:
    """The highest score of any of the objects in a frame; 0 where a frame makes no sense."""
    models = [detector.models[name] for name in objects or detector.objects]
    if check_depth_scale(frame, models):
        return 0.0  # objects of no size that could be found, and slow to look for
    try:
        found = detector.search(frame.rgb, frame.depth, frame.camera_matrix, objects, 1, 0.0)
    except InputError:
        return 0.0
    return max((each.score for each in found.detections), default=0.0)


def check_by_search(frames: Sequence[Frame], stated: float, find_best: FindBest) -> list[Finding]:
    """The fault that keeps objects from being found in the first of some frames.

    `stated` is the best score there. Objects must then be found in the next frame too, and more
    certainly if there is none: something may look like an absent object after some change. It takes
    about 14 searches.
    """
    if not frames:
        return []
    frame, others = frames[0], frames[1:2]
    certain = _CERTAIN if others else _CERTAIN_ALONE

    def confirmed(changes: Sequence[Callable[[Frame], Frame]]) -> bool:
        return all(
            any(find_best(change(other)) >= _CERTAIN for change in changes) for other in others
        )

    swapped = find_best(_swapped(frame))
    if swapped >= max(certain, stated + _COLOR_GAIN) and confirmed([_swapped]):
        problem = "red and blue may be exchanged"
        advice = "OpenCV reads blue first: write RGB"
        return [_finding("colours", problem, advice, frame, swapped, stated)]
    if stated >= _FOUND:
        return []
    tried = {each: find_best(each.frame(frame)) for row in _CHANGES for each in row}
    best = max(tried, key=lambda each: tried[each])
    (row,) = [row for row in _CHANGES if best in row]
    # The fault lies between two of the factors: another of them may suit the other frame better.
    alike = [each.frame for each in sorted(row, key=lambda each: each != best)]
    if tried[best] < max(certain, stated + _GAIN) or not confirmed(alike):
        return []
    kind, problem, advice = _described(best)
    return [_finding(kind, problem, advice, frame, tried[best], stated)]


def _described(change: Correction) -> tuple[str, str, str]:
    """Kind, problem and advice."""
    if change.focal != 1.0:
        problem = f"the focal length may be {1 / change.focal:.2g} times what it should be"
        return "intrinsics", problem, "Check fx and fy"
    problem = (
        f"depth may be {1 / change.depth:.3g} times what it should be, or the mesh in another unit"
    )
    return "depth scale", problem, "Check depth_scale and mesh_scale"


def _finding(
    kind: str, problem: str, advice: str, frame: Frame, score: float, stated: float
) -> Finding:
    gain = f"objects are found then with a score of {score:.2f}, not {stated:.2f}"
    return Finding(kind, f"frame {frame.key}", f"{problem}: {gain}", advice)


def _swapped(frame: Frame) -> Frame:
    return replace(frame, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))
