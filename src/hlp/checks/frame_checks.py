"""Whether frames can be read, and what is seen in them alone, without poses or a search."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hlp.checks.finding import Finding
from hlp.checks.registration import check_registration
from hlp.errors import HlpError
from hlp.objects.mesh_colors import SMALL
from hlp.records import Frame, ObjectModel

_SHOWN = 3  # findings of one kind
_ADVICE = {"files": "Copy or download it again", "values": "Mend it, or leave this frame out"}


def read_frames(
    load: Callable[[str], Frame],
    keys: Sequence[str],
    kept: int,
    read: Callable[[str], Frame] | None = None,
) -> tuple[list[Frame], list[Finding]]:
    """Some of the frames, spread evenly, and what is wrong with any of them.

    Every frame is decoded; at most about `kept` are returned. `read` decodes without asking whether
    the values make sense: a frame that only `load` refuses is returned too, with a finding of kind
    "values". Of many findings of a kind, the first ones are returned, and how many more there are.
    """
    every = max(len(keys) // max(kept, 1), 1)
    frames, wrong = [], dict[str, list[Finding]]()
    for number, key in enumerate(keys):
        try:
            frame = load(key)
        except HlpError as refusal:
            try:
                frame, kind, error = _again(read, key, refusal), "values", refusal
            except HlpError as failure:
                kind, error = "files", failure
            findings = wrong.setdefault(kind, [])
            findings.append(Finding(kind, key, str(error), _ADVICE[kind]))
            if kind == "files":
                continue
        if number % every == 0:
            frames.append(frame)
    return frames, [each for findings in wrong.values() for each in _first(findings)]


def _again(read: Callable[[str], Frame] | None, key: str, refusal: HlpError) -> Frame:
    if read is None:
        raise refusal
    return read(key)


def _first(findings: Sequence[Finding]) -> list[Finding]:
    """The first findings of a kind; what is left out is counted in the last one."""
    left = len(findings) - _SHOWN
    if left <= 0:
        return list(findings)
    last = findings[_SHOWN - 1]
    return [*findings[: _SHOWN - 1], replace(last, where=f"{last.where} (and {left} more frames)")]


def check_frames(frames: Sequence[Frame], models: Sequence[ObjectModel]) -> list[Finding]:
    """The quick checks: a tenth of a second for a frame. `models` are looked for, or none."""
    if not frames:
        return []
    return [*check_first_frame(frames[0], models), *check_registration(frames)]


def check_first_frame(frame: Frame, models: Sequence[ObjectModel]) -> list[Finding]:
    """What one frame is enough for: intrinsics, and the units of depth and meshes."""
    return [
        *check_intrinsics(frame),
        *check_object_size(models),
        *check_depth_scale(frame, models),
    ]


_OFF_CENTER = 0.15  # of the image's width or height
_FOCAL = (0.3, 4.0)  # times the image's width: 118° to 14° of view
_RATIO = 1.5  # of both focal lengths
_SMALLEST, _LARGEST = 24.0, 3.0  # px of an object that can be found; times the image's width
_USUAL = (0.15, 8.0)  # m: where half of the depth of an indoor scene begins


def check_intrinsics(frame: Frame) -> list[Finding]:
    """Intrinsics of images of another size, or with exchanged or impossible numbers."""
    height, width = frame.depth.shape
    matrix = frame.camera_matrix
    found = []
    off = np.abs(matrix[:2, 2] - [(width - 1) / 2, (height - 1) / 2]) / [width, height]
    if off.max() > _OFF_CENTER:
        found.append(
            Finding(
                "intrinsics",
                f"images of {width}x{height}",
                f"the principal point ({matrix[0, 2]:.0f}, {matrix[1, 2]:.0f}) is far from their "
                "middle",
                "They belong to images of another size or to a crop: take those of this stream",
            )
        )
    across, down = matrix[0, 0], matrix[1, 1]
    low, high = _FOCAL[0] * width, _FOCAL[1] * width
    if not (low <= across <= high and low <= down <= high):
        found.append(
            Finding(
                "intrinsics",
                f"images of {width}x{height}",
                f"focal lengths of {across:.0f} and {down:.0f} px are those of no depth camera",
                "Give fx and fy in pixels, not in millimetres",
            )
        )
    elif max(across / down, down / across) > _RATIO:
        found.append(
            Finding(
                "intrinsics",
                f"images of {width}x{height}",
                f"fx = {across:.0f} and fy = {down:.0f} px are very different",
                "Check the order of the numbers: fx, fy, cx, cy",
            )
        )
    return found


def check_depth_scale(frame: Frame, models: Sequence[ObjectModel]) -> list[Finding]:
    """Depth in another unit: the objects would be too small or too large to be seen."""
    present = frame.depth[frame.depth > 0]
    if not len(present):
        return []
    median, near, far = (float(np.percentile(present, share)) for share in (50, 10, 90))
    focal = float(frame.camera_matrix[0, 0])
    width = frame.depth.shape[1]
    problem = ""
    if models:
        largest = max(model.diameter for model in models)
        smallest = min(model.diameter for model in models)
        if focal * largest / near < _SMALLEST:
            problem = f"{models[0].name} would be {focal * largest / near:.0f} px large at most"
        elif focal * smallest / far > _LARGEST * width:
            problem = f"{models[0].name} would be larger than the image"
    if not problem and not _USUAL[0] <= median <= _USUAL[1]:
        problem = "few depth cameras measure that"
    if not problem:
        return []
    return [
        Finding(
            "depth scale",
            "depth images",
            f"half of the depth is nearer than {median:.3g} m: {problem}",
            "Give depth_scale, in millimetres per unit of the depth images",
        )
    ]


def check_object_size(models: Sequence[ObjectModel]) -> list[Finding]:
    """Objects so small that their meshes may be in centimetres."""
    return [
        Finding(
            "mesh unit",
            model.name,
            f"it is {model.diameter * 1000:.0f} mm large",
            f"If it is {model.diameter * 10000:.0f} mm in truth, its mesh is in centimetres: learn "
            "it with mesh_scale=0.01",
        )
        for model in models
        if model.diameter < SMALL
    ]
