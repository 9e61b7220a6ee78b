"""Whether true poses fit the depth images; if not, which single fault explains it.

Every fault that is known to happen is undone in turn. The one after which objects rendered at their
poses agree with the depth images is named.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hlp.arrays import Pose
from hlp.checks import Finding
from hlp.checks.corrections import UNCHANGED, Correction, check_gains
from hlp.checks.known_objects import exchange_gain
from hlp.checks.registration import Registration, find_registration
from hlp.geometry import inverse, rigid
from hlp.records import Frame, ObjectModel
from hlp.rendering.rasterizer import render_depth

_AGREES = 0.02  # m
_FITS = 0.5  # share of an object's pixels that agree where everything is right
_CLEARLY_FITS = 0.9  # then no fault is looked for
_GAIN = 0.25  # that undoing a fault must bring
_ENOUGH = 50  # px of an object
_MOST_TARGETS = 6
_ALIKE = 0.05  # of the agreement: either fault may be it
_HARDLY = 0.3  # agreement of objects of a wrong size
_MEND_POSES = "Correct the translations, or where the meshes have their origin"


@dataclass(frozen=True)
class Sample:
    """One target in its frame, as it is stated or with a fault undone."""

    frame: Frame
    model: ObjectModel
    pose: Pose


@dataclass(frozen=True)
class Fault:
    """A fault: its kind, in words, what to do, and what undoes it.

    That is a correction of the frame, a change of the pose, or a factor of the mesh.
    """

    kind: str
    problem: str
    advice: str
    correction: Correction = UNCHANGED
    change: Callable[[Pose], Pose] = np.copy
    mesh: float = 1.0

    def undo(self, sample: Sample) -> Sample:
        """The sample as it would be without the fault."""
        proxy = sample.model.proxy
        proxy = replace(proxy, vertices=proxy.vertices * self.mesh)
        model = replace(sample.model, proxy=proxy)
        return Sample(self.correction.frame(sample.frame), model, self.change(sample.pose))


def _moved(metres: float, pose: Pose) -> Pose:
    """The pose farther away by so much."""
    return _scaled(1.0 + metres / float(np.linalg.norm(pose[:3, 3])), pose)


def _scaled(factor: float, pose: Pose) -> Pose:
    return rigid(pose[:3, :3], pose[:3, 3] * factor)


def _faults() -> Iterator[Fault]:
    words, advice = "rotations are transposed", "Write R row by row, object to camera"
    yield Fault("rotations", words, advice, change=lambda pose: rigid(pose[:3, :3].T, pose[:3, 3]))
    advice = "Invert them: object to camera"
    yield Fault("poses", "poses map camera to object coordinates", advice, change=inverse)
    words, advice = "poses have y up and look along -z (OpenGL)", "Turn y and z round (OpenCV)"
    yield Fault("axes", words, advice, change=lambda pose: np.diag([1.0, -1.0, -1.0, 1.0]) @ pose)
    for factor in (0.1, 0.125, 0.25, 0.5, 0.9, 0.95, 1.05, 1.1, 2.0, 4.0, 8.0, 10.0):
        words = f"depth is {1 / factor:.3g} times what it should be"
        yield Fault("depth scale", words, "Correct depth_scale", Correction(depth=factor))
    for metres in (-0.1, -0.06, -0.03, -0.015, 0.015, 0.03, 0.06, 0.1):  # m
        words = f"true poses are {1000 * abs(metres):.0f} mm too {'near' if metres > 0 else 'far'}"
        yield Fault("poses", words, _MEND_POSES, change=partial(_moved, metres))
    for factor in (0.01, 0.1, 10.0, 100.0, 1000.0):
        words = f"translations are {1 / factor:.3g} times what they should be"
        yield Fault("pose unit", words, "Write millimetres", change=partial(_scaled, factor))
    for factor in (0.1, 10.0, 25.4):
        words = f"meshes are {1 / factor:.3g} times as large as they should be"
        yield Fault("mesh unit", words, "Write millimetres", mesh=factor)
    for factor in (0.5, 0.67, 0.75, 0.8, 0.9, 1.1, 1.25, 1.33, 1.5, 1.9, 2.0):
        words = f"the focal length is about {1 / factor:.2g} times what it should be"
        yield Fault("intrinsics", words, "Correct fx and fy", Correction(focal=factor))
    for factor in (0.5, 2 / 3, 1.5, 2.0):
        words = f"intrinsics are those of images {1 / factor:.2g} times as large"
        yield Fault("intrinsics", words, "Correct them", Correction(image=factor))
    shifts = (-40, -30, -20, -10, -5, 5, 10, 20, 30, 40)  # px
    for dx, dy in (place for shift in shifts for place in ((shift, 0), (0, shift))):
        words = f"depth is shifted against the poses by about ({-dx}, {-dy}) px"
        place = Correction(registration=Registration(right=dx, down=dy))
        yield Fault("registration", words, "Register depth to colour", place)


FAULTS = tuple(_faults())
"""Faults that are looked for."""


def check_true_poses(frames: Sequence[Frame], models: Mapping[int, ObjectModel]) -> list[Finding]:
    """The fault after whose removal the poses fit, or that they fit nowhere."""
    samples = _samples(frames, models)[:_MOST_TARGETS]
    if not samples or (stated := agreement(samples)) >= _CLEARLY_FITS:
        return []
    # A tiny object agrees with anything behind which it stands.
    possible = [fault for fault in FAULTS if fault.mesh >= 1.0 or stated < _HARDLY]
    shares = [agreement([fault.undo(sample) for sample in samples]) for fault in possible]
    best = int(np.argmax(shares))
    where = f"{len(samples)} targets"
    seen = f"{100 * stated:.0f} % of the objects' pixels agree with the depth"
    if shares[best] >= stated + _GAIN:
        fault = possible[best]
        place = fault.correction.registration
        if place is not None and find_registration(frames, whole=True) is None:
            beside = f"true poses lie about ({place.right}, {place.down}) px beside the objects"
            fault = replace(fault, kind="poses", problem=beside, advice=_MEND_POSES)
        words = [fault.problem]
        for other, share in zip(possible, shares, strict=True):
            either = {other.kind, fault.kind} == {"poses", "depth scale"}  # as of one distance
            if either and len(words) == 1 and share >= shares[best] - _ALIKE:
                words.append(other.problem)
        problem = f"{' or '.join(words)}: {seen}, {100 * shares[best]:.0f} % without"
        return [Finding(fault.kind, where, problem, fault.advice)]
    if stated >= _FITS:
        return []
    problem = f"{seen}, and no single known fault explains it"
    advice = "Look at the overlay: are poses, meshes and images of one data set?"
    return [Finding("poses", where, problem, advice)]


def _samples(frames: Sequence[Frame], models: Mapping[int, ObjectModel]) -> list[Sample]:
    """The targets that are well visible."""
    return [
        Sample(frame, models[target.object_id], target.pose_cam_obj)
        for frame in frames
        for target in frame.targets
        if target.object_id in models
        and not target.visible_fraction < 0.6  # nan where it is not stated
    ]


def check_true_colors(frames: Sequence[Frame], models: Mapping[int, ObjectModel]) -> list[Finding]:
    """Red and blue exchanged: the colours of objects at their true poses agree better then."""
    placed = [[(each.model, each.pose) for each in _samples([frame], models)] for frame in frames]
    return check_gains(list(map(exchange_gain, frames, placed)))


def agreement(samples: Sequence[Sample]) -> float:
    """Median share of the objects' pixels whose depth is that of the image; 0 where none shows."""
    return float(np.median([_agreement(sample) for sample in samples]))


def _agreement(sample: Sample) -> float:
    if not np.isfinite(sample.pose).all():
        return 0.0
    depth, camera_matrix = sample.frame.depth, sample.frame.camera_matrix
    drawn = sample.model.proxy, sample.pose[None], camera_matrix, depth.shape
    rendered = render_depth(*drawn, threads=1)[0]
    both = (rendered > 0) & (depth > 0)
    if np.count_nonzero(both) < _ENOUGH:
        return 0.0
    return float((np.abs(rendered[both] - depth[both]) < _AGREES).mean())
