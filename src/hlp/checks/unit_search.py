"""Whether learnt objects are found, or only after a fault is undone.

For frames without true poses: depth, focal length and colours are changed in turn, and the change
after which an object is found with certainty is named.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from hlp.checks.finding import Finding
from hlp.records import Frame

FindBest = Callable[[Frame], float]
"""The highest score of any learnt object in a frame."""

_FOUND = 0.6  # a score that needs no explanation
_GAIN = 0.3  # that undoing a fault must bring
_COLOR_GAIN = 0.15  # colours are a small part of the score
_DEPTHS = (0.1, 0.5, 0.9, 1.1, 2.0, 10.0)
_FOCALS = (0.53, 0.67, 0.8, 1.25, 1.5, 2.0)


def check_by_search(frames: Sequence[Frame], find_best: FindBest) -> list[Finding]:
    """The fault that keeps objects from being found in the best of some frames."""
    if not frames:
        return []
    scores = [find_best(frame) for frame in frames]
    best = int(np.argmax(scores))
    frame, stated = frames[best], scores[best]
    where = f"frame {frame.key}"
    swapped = find_best(_swapped(frame))
    if swapped > stated + _COLOR_GAIN:
        return [
            Finding(
                "colours",
                where,
                f"objects fit better with red and blue exchanged (score {swapped:.2f} against "
                f"{stated:.2f})",
                "OpenCV reads blue first: write RGB",
            )
        ]
    if stated >= _FOUND:
        return []
    tried = [(find_best(changed), words) for changed, words in _changes(frame)]
    score, (kind, problem, advice) = max(tried, key=lambda each: each[0])
    if score < max(_FOUND, stated + _GAIN):
        return []
    return [
        Finding(
            kind, where, f"{problem}: objects are found then with a score of {score:.2f}, not "
            f"{stated:.2f}", advice,
        )
    ]  # fmt: skip


def _changes(frame: Frame) -> Iterator[tuple[Frame, tuple[str, str, str]]]:
    for factor in _DEPTHS:
        yield (
            replace(frame, depth=(frame.depth * factor).astype(np.float32)),
            (
                "depth scale",
                f"depth may be {1 / factor:.3g} times what it should be, or the mesh in another "
                "unit",
                "Check depth_scale and mesh_scale",
            ),
        )
    for factor in _FOCALS:
        matrix = frame.camera_matrix.copy()
        matrix[[0, 1], [0, 1]] *= factor
        yield (
            replace(frame, camera_matrix=matrix),
            (
                "intrinsics",
                f"the focal length may be {1 / factor:.2g} times what it should be",
                "Check fx and fy",
            ),
        )


def _swapped(frame: Frame) -> Frame:
    return replace(frame, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))
