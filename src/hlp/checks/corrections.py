"""What undoes a fault of a frame, and whether several frames show that it does.

An object that is seen a tenth too near, or by a focal length that is too long, is drawn too large:
it fits better after the correction. A fault is one that most frames show.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hlp.arrays import Point, Pose
from hlp.checks import Finding
from hlp.checks.registration import Registration
from hlp.geometry import rigid, transform
from hlp.records import Frame

UNITS = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""Units of depth that cameras have, 1/8 mm to 1 mm, in each other."""
# Gains that say so clearly: in the median of three frames or more, and in each of fewer. Where the
# object is mostly hidden, or is no such object, a pose may fit better by chance.
_COST, _COST_ALONE = 0.035, 0.06  # of the verification cost, which most corrections raise
_COLORS, _COLORS_ALONE = 0.4, 0.8  # of the correlation: about 0 for grey, above 1 for much colour
_ENOUGH = 3  # frames that must say the same
_SHARE = 0.75  # of the frames that must say the same


@dataclass(frozen=True)
class Correction:
    """Factors of the depth image, of focal lengths, and of all intrinsics; depth's place; colours.

    `registration` is where depth lies in the colours, `exchanged` says that blue was read first.
    """

    depth: float = 1.0
    focal: float = 1.0
    image: float = 1.0
    registration: Registration | None = None
    exchanged: bool = False

    def frame(self, frame: Frame) -> Frame:
        """The frame as it would be without the fault."""
        if self.registration is not None:
            frame = self.registration.frame(frame)
        matrix = frame.camera_matrix.copy()
        matrix[[0, 1], [0, 1]] *= self.focal
        matrix[:2] *= self.image
        depth = (frame.depth * self.depth).astype(np.float32)
        rgb = np.ascontiguousarray(frame.rgb[..., ::-1]) if self.exchanged else frame.rgb
        return replace(frame, rgb=rgb, depth=depth, camera_matrix=matrix)

    def pose(self, pose_cam_obj: Pose, centroid: Point) -> Pose:
        """A pose of which the object's centroid is where the corrected frame shows it."""
        seen = transform(pose_cam_obj, centroid[None])[0]
        moved = seen * self.depth * np.array([1.0 / self.focal, 1.0 / self.focal, 1.0])
        return rigid(pose_cam_obj[:3, :3], pose_cam_obj[:3, 3] + (moved - seen))

    def finding(self, where: str, because: str, unit: float | None = None) -> Finding:
        """The fault; `because` says what is better without it. Depth was read in `unit` mm."""
        kind, advice = "depth scale", "Check depth_scale and mesh_scale"
        problem = (
            f"depth may be {1 / self.depth:.2g} times what it should be, or the mesh "
            f"{self.depth:.2g} times as large as the object"
        )
        if self.exchanged:
            kind, problem = "colours", "red and blue may be exchanged"
            advice = "OpenCV reads blue first: write RGB"
        elif self.focal != 1.0:
            kind = "intrinsics"
            problem = f"the focal length may be {1 / self.focal:.2g} times what it should be"
            advice = "Check fx and fy: are they those of images of another size?"
        elif self.depth in UNITS and unit is not None:
            problem = f"depth may be in units of {unit * self.depth:g} mm, not {unit:g}"
            advice = f"Give depth_scale={unit * self.depth:g}"
        return Finding(kind, where, f"{problem}: {because}", advice)


UNCHANGED, EXCHANGED = Correction(), Correction(exchanged=True)
ROWS = (
    tuple(Correction(depth=factor) for factor in (0.9, 0.5, 0.25, 0.125, 0.1)),
    tuple(Correction(depth=factor) for factor in (1.0 / 0.9, 2.0, 4.0, 8.0, 10.0)),
    tuple(Correction(focal=factor) for factor in (1.33, 1.5, 2.0)),
    tuple(Correction(focal=factor) for factor in (0.77, 0.67, 0.53)),
)
"""Corrections of one kind from small to large: a fault lies between two of them."""


def check_gains(frames: Sequence[Mapping[Correction, float]]) -> list[Finding]:
    """The fault whose correction helps most, colours first: one disturbs the signs of others.

    `frames` are how much less known objects cost in each after each correction, and how much better
    their colours agree with red and blue exchanged.
    """
    tried = dict.fromkeys(each for gains in frames for each in gains)
    gains = {each: gain for each in tried if (gain := _certain_gain(each, frames))}
    best = max(gains, key=lambda each: (each.exchanged, gains[each]), default=None)
    if best is None:
        return []
    count = sum(best in gains for gains in frames)
    where = "this frame alone" if count == 1 else f"{count} frames"
    measure = "correlation of colours higher" if best.exchanged else "cost lower"
    because = f"known objects fit better when it is corrected ({measure} by {gains[best]:.3f})"
    return [best.finding(where, because)]


def _certain_gain(correction: Correction, frames: Sequence[Mapping[Correction, float]]) -> float:
    """The median of the frames that say something, if they say enough; 0 otherwise."""
    clear, alone = (_COLORS, _COLORS_ALONE) if correction.exchanged else (_COST, _COST_ALONE)
    known = [gains[correction] for gains in frames if correction in gains]
    median = float(np.median(known))
    if len(known) < _ENOUGH:
        certain = min(known) >= alone and len(known) >= min(len(frames), 2)
    else:
        agreeing = sum(gain > 0.0 for gain in known)
        certain = median >= clear and agreeing >= _SHARE * len(known)
    return median if certain else 0.0
