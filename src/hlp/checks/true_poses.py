"""Whether true poses fit the depth images; if not, which single fault explains it.

Every fault that is known to happen is undone in turn. The one after which objects rendered at their
poses agree with the depth images is named.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hlp.checks.finding import Finding
from hlp.records import Frame, ObjectModel
from hlp.rendering.rasterizer import render_depth

Pose = Float[np.ndarray, "4 4"]
_AGREES = 0.02  # m
_FITS = 0.5  # share of an object's pixels that agree where everything is right
_CLEARLY_FITS = 0.9  # then no fault is looked for
_GAIN = 0.25  # that undoing a fault must bring
_FEWEST = 50  # px of an object
_MOST_TARGETS = 6
_SCALES = (0.1, 0.5, 0.9, 1.1, 2.0, 10.0)
_FOCALS = (0.5, 0.67, 0.75, 0.8, 0.9, 1.1, 1.25, 1.33, 1.5, 1.9, 2.0)
_SHIFT = (-20, -10, -5, 5, 10, 20)  # px
_HARDLY = 0.3  # agreement of objects of a wrong size
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL's camera to OpenCV's


@dataclass(frozen=True)
class Sample:
    """One target in its frame, as it is stated or with a fault undone."""

    frame: Frame
    model: ObjectModel
    pose: Pose


@dataclass(frozen=True)
class Fault:
    """A fault: its kind, in words, what to do, and how to undo it.

    It explains only less than `most` agreement.
    """

    kind: str
    problem: str
    advice: str
    undo: Callable[[Sample], Sample]
    most: float = 1.0


def check_true_poses(frames: Sequence[Frame], models: Mapping[int, ObjectModel]) -> list[Finding]:
    """The fault after whose removal the poses fit, or that they fit nowhere."""
    samples = [
        Sample(frame, models[target.object_id], target.pose_cam_obj)
        for frame in frames
        for target in frame.targets
        if target.object_id in models
        and not target.visible_fraction < 0.6  # nan where it is not stated
    ][:_MOST_TARGETS]
    if not samples:
        return []
    stated = agreement(samples)
    if stated >= _CLEARLY_FITS:
        return []
    possible = [fault for fault in FAULTS if stated < fault.most]
    tried = [(agreement([fault.undo(each) for each in samples]), fault) for fault in possible]
    share, fault = max(tried, key=lambda each: each[0])
    where = f"{len(samples)} targets"
    seen = f"{100 * stated:.0f} % of the objects' pixels agree with the depth"
    if share < stated + _GAIN:
        if stated >= _FITS:
            return []
        return [
            Finding(
                "poses",
                where,
                f"{seen}, and no single known fault explains it",
                "Look at the overlay: are poses, meshes and images of one data set?",
            )
        ]
    return [
        Finding(
            fault.kind, where, f"{fault.problem}: {seen}, {100 * share:.0f} % without", fault.advice
        )
    ]


def agreement(samples: Sequence[Sample]) -> float:
    """Median share of the objects' pixels whose depth is that of the image; 0 where none shows."""
    return float(np.median([_agreement(each) for each in samples]))


def _agreement(sample: Sample) -> float:
    frame = sample.frame
    height, width = frame.depth.shape
    if not np.isfinite(sample.pose).all():
        return 0.0
    rendered = render_depth(
        sample.model.proxy, sample.pose[None], frame.camera_matrix, (height, width), threads=1
    )[0]
    both = (rendered > 0) & (frame.depth > 0)
    if np.count_nonzero(both) < _FEWEST:
        return 0.0
    return float((np.abs(rendered[both] - frame.depth[both]) < _AGREES).mean())


def _with_depth(factor: float) -> Callable[[Sample], Sample]:
    def undo(sample: Sample) -> Sample:
        depth = (sample.frame.depth * factor).astype(np.float32)
        return replace(sample, frame=replace(sample.frame, depth=depth))

    return undo


def _with_camera(
    change: Callable[[Float[np.ndarray, "3 3"]], Float[np.ndarray, "3 3"]],
) -> Callable[[Sample], Sample]:
    def undo(sample: Sample) -> Sample:
        matrix = change(sample.frame.camera_matrix.copy())
        return replace(sample, frame=replace(sample.frame, camera_matrix=matrix))

    return undo


def _focal(factor: float) -> Callable[[Float[np.ndarray, "3 3"]], Float[np.ndarray, "3 3"]]:
    def change(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        matrix[[0, 1], [0, 1]] *= factor
        return matrix

    return change


def _image_size(factor: float) -> Callable[[Float[np.ndarray, "3 3"]], Float[np.ndarray, "3 3"]]:
    def change(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        matrix[:2] *= factor
        return matrix

    return change


def _with_pose(change: Callable[[Pose], Pose]) -> Callable[[Sample], Sample]:
    return lambda sample: replace(sample, pose=change(sample.pose))


def _transposed(pose: Pose) -> Pose:
    turned = pose.copy()
    turned[:3, :3] = pose[:3, :3].T
    return turned


def _moved(factor: float) -> Callable[[Pose], Pose]:
    def change(pose: Pose) -> Pose:
        moved = pose.copy()
        moved[:3, 3] *= factor
        return moved

    return change


def _with_mesh(factor: float) -> Callable[[Sample], Sample]:
    def undo(sample: Sample) -> Sample:
        proxy = replace(sample.model.proxy, vertices=sample.model.proxy.vertices * factor)
        return replace(sample, model=replace(sample.model, proxy=proxy))

    return undo


def _with_shift(dx: int, dy: int) -> Callable[[Sample], Sample]:
    def undo(sample: Sample) -> Sample:
        depth = np.roll(sample.frame.depth, (dy, dx), axis=(0, 1))
        return replace(sample, frame=replace(sample.frame, depth=depth))

    return undo


def _faults() -> list[Fault]:
    found = [
        Fault(
            "rotations", "rotations are transposed", "Write R row by row, object to camera",
            _with_pose(_transposed),
        ),
        Fault(
            "poses", "poses map camera to object coordinates", "Invert them: object to camera",
            _with_pose(np.linalg.inv),
        ),
        Fault(
            "axes", "poses have y up and look along -z (OpenGL)", "Turn y and z round (OpenCV)",
            _with_pose(lambda pose: _FLIP @ pose),
        ),
    ]  # fmt: skip
    for factor in _SCALES:
        words = f"depth is {1 / factor:.3g} times what it should be"
        found.append(Fault("depth scale", words, "Correct depth_scale", _with_depth(factor)))
    for factor in (0.01, 0.1, 10.0, 100.0, 1000.0):
        words = f"translations are {1 / factor:.3g} times what they should be"
        found.append(Fault("pose unit", words, "Write millimetres", _with_pose(_moved(factor))))
    for factor in (0.1, 10.0, 25.4):
        words = f"meshes are {1 / factor:.3g} times as large as they should be"
        # A tiny object agrees with anything behind which it stands.
        most = _HARDLY if factor < 1.0 else 1.0
        found.append(Fault("mesh unit", words, "Write millimetres", _with_mesh(factor), most))
    for factor in _FOCALS:
        words = f"the focal length is about {1 / factor:.2g} times what it should be"
        found.append(Fault("intrinsics", words, "Correct fx and fy", _with_camera(_focal(factor))))
    for factor in (0.5, 2 / 3, 1.5, 2.0):
        words = f"intrinsics are those of images {1 / factor:.2g} times as large"
        found.append(Fault("intrinsics", words, "Correct them", _with_camera(_image_size(factor))))
    for shift in _SHIFT:
        for dx, dy in ((shift, 0), (0, shift)):
            words = f"depth is shifted against the poses by about ({-dx}, {-dy}) px"
            advice = "Register depth to colour"
            found.append(Fault("registration", words, advice, _with_shift(dx, dy)))
    return found


FAULTS = tuple(_faults())
"""Faults that are looked for."""
