"""Whether depth or focal lengths are wrong: known objects fit better after a correction.

An object that is seen a tenth too near, or by a focal length that is too long, is drawn too large.
Where it is found nonetheless, its pose costs more than after the correction, in nearly every frame.
From the pose that it was found at it is followed by the refiner alone.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hlp.checks.finding import Finding, counted
from hlp.geometry import transform
from hlp.method.find.detections import Detection
from hlp.records import Frame, ObjectModel

Refine = Callable[[Frame, Detection], Detection | None]
"""The best pose of an object about where an answer says that it is in a frame."""

_CERTAIN = 0.8  # score of the answer, or of that after the correction
_CLEAR = 0.015  # of the verification cost, which a correction raises in most healthy frames
_FEWEST = 3  # frames that must say the same
_SHARE = 0.75  # of the frames that must say the same
# Of one or two frames each must say it more clearly: where the object is mostly hidden, or is no
# such object, a pose may fit better by chance.
_CLEAR_ALONE = 0.02  # where the answer is certain
_CLEAR_UNCERTAIN = 0.06  # where it is only after the correction


@dataclass(frozen=True)
class Correction:
    """Factors of the depth image and of both focal lengths."""

    depth: float = 1.0
    focal: float = 1.0

    def frame(self, frame: Frame) -> Frame:
        """The frame as it would be without the fault."""
        matrix = frame.camera_matrix.copy()
        matrix[[0, 1], [0, 1]] *= self.focal
        depth = (frame.depth * self.depth).astype(np.float32)
        return replace(frame, depth=depth, camera_matrix=matrix)

    def pose(
        self, pose_cam_obj: Float[np.ndarray, "4 4"], centroid: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "4 4"]:
        """A pose of which the object's centroid is where the corrected frame shows it."""
        seen = transform(pose_cam_obj, centroid[None])[0]
        moved = seen * self.depth * np.array([1.0 / self.focal, 1.0 / self.focal, 1.0])
        corrected = pose_cam_obj.copy()
        corrected[:3, 3] += moved - seen
        return corrected


@dataclass(frozen=True)
class CorrectedFits:
    """How much less the best answer to a frame costs after corrections that say something.

    `certain`: the answer has a high score without any.
    """

    certain: bool
    gains: Mapping[Correction, float]


# Each row from small to large: a larger one is tried only where the smaller one helps.
_CORRECTIONS = (
    (Correction(depth=0.9),),
    (Correction(depth=1.0 / 0.9),),
    (Correction(focal=1.33), Correction(focal=1.5), Correction(focal=2.0)),
    (Correction(focal=0.77), Correction(focal=0.67), Correction(focal=0.53)),
)


def correction_gains(
    frame: Frame,
    models: Mapping[str, ObjectModel],
    answers: Sequence[Detection],
    refine: Refine,
) -> CorrectedFits:
    """How much less the most certain answer to a frame costs after each correction.

    A correction is left out if the pose is uncertain before and after it: the cost of a wrong pose
    says nothing. `models` are by the names of the answers.
    """
    best = max(answers, key=lambda each: each.score, default=None)
    gains = dict[Correction, float]()
    if best is None:
        return CorrectedFits(False, gains)
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
    return CorrectedFits(best.score >= _CERTAIN, gains)


def check_corrections(fits: Sequence[CorrectedFits]) -> list[Finding]:
    """The fault whose correction helps most.

    Most of at least three frames must say so; both of two, or the only one, more clearly. `fits`
    are those of `correction_gains`, one for each frame.
    """
    clear = dict[Correction, float]()
    for correction in (each for row in _CORRECTIONS for each in row):
        told = [each for each in fits if correction in each.gains]
        if told and len(told) >= min(len(fits), 2) and _helps(correction, told):
            clear[correction] = float(np.median([each.gains[correction] for each in told]))
    best = max(clear, key=lambda each: clear[each], default=None)
    if best is None or clear[best] < _CLEAR:
        return []
    count = sum(best in each.gains for each in fits)
    return [_finding(best, counted(count), f"cost lower by {clear[best]:.3f}")]


def _helps(correction: Correction, fits: Sequence[CorrectedFits]) -> bool:
    if len(fits) < _FEWEST:
        return all(
            each.gains[correction] >= (_CLEAR_ALONE if each.certain else _CLEAR_UNCERTAIN)
            for each in fits
        )
    agreeing = sum(each.gains[correction] > 0.0 for each in fits)
    return agreeing >= _SHARE * len(fits)


def _finding(correction: Correction, where: str, gain: str) -> Finding:
    if correction.depth == 1.0:
        return Finding(
            "intrinsics",
            where,
            f"the focal length may be {1.0 / correction.focal:.2g} times what it should be: known "
            f"objects fit better when it is corrected ({gain})",
            "Check fx and fy: are they those of images of another size?",
        )
    return Finding(
        "depth scale",
        where,
        f"depth may be {1.0 / correction.depth:.2g} times what it should be, or the mesh "
        f"{correction.depth:.2g} times as large as the object: known objects fit better when depth "
        f"is corrected ({gain})",
        "Check depth_scale and mesh_scale",
    )
