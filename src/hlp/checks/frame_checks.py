"""What is seen in frames alone, without poses or a search."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from hlp.checks import Finding
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
    """Some of the frames, spread over all of them, and what is wrong with any of them.

    Every frame is decoded; at most about `kept` are returned. `read` decodes without asking whether
    the values make sense: a frame that only `load` refuses is returned too, with a finding of kind
    "values". Of many findings of a kind, the first ones are returned, and how many more there are.
    """
    every = max(len(keys) // max(kept, 1), 1)
    frames, wrong = [], dict[str, list[Finding]]()
    for number, key in enumerate(keys):
        frame = None
        try:
            frame = load(key)
        except HlpError as error:
            with suppress(HlpError):
                frame = read and read(key)
            kind = "files" if frame is None else "values"
            wrong.setdefault(kind, []).append(Finding(kind, key, str(error), _ADVICE[kind]))
        if frame is not None and number % every == 0:
            frames.append(frame)
    shown = list[Finding]()
    for findings in wrong.values():
        shown += findings[:_SHOWN]
        if left := len(findings[_SHOWN:]):
            shown[-1] = replace(shown[-1], where=f"{shown[-1].where} (and {left} more frames)")
    return frames, shown


def check_frames(frames: Sequence[Frame], models: Sequence[ObjectModel]) -> list[Finding]:
    """What takes no search: three seconds for all. `models` are looked for, or none."""
    if not frames:
        return []
    return [*check_first_frame(frames[0], models), *check_registration(frames, whole=True)]


def check_first_frame(frame: Frame, models: Sequence[ObjectModel]) -> list[Finding]:
    """What one frame is enough for: intrinsics, and the units of depth and meshes."""
    return [*check_intrinsics(frame), *check_object_size(models), *check_depth_scale(frame, models)]


_OFF_CENTER = 0.15  # of the image's width or height
_FOCAL = (0.3, 4.0)  # times the image's width: 118° to 14° of view
_RATIO = 1.5  # of both focal lengths
_SMALLEST, _LARGEST = 24.0, 3.0  # px of an object that can be found; times the image's width
_USUAL = (0.15, 8.0)  # m: where half of the depth of an indoor scene begins


def check_intrinsics(frame: Frame) -> list[Finding]:
    """Intrinsics of images of another size, or with exchanged or impossible numbers."""
    height, width = frame.depth.shape
    matrix = frame.camera_matrix
    x, y, fx, fy = matrix[0, 2], matrix[1, 2], matrix[0, 0], matrix[1, 1]
    found = list[tuple[str, str]]()
    off = np.abs(matrix[:2, 2] - [(width - 1) / 2, (height - 1) / 2]) / [width, height]
    if off.max() > _OFF_CENTER:
        problem = f"the principal point ({x:.0f}, {y:.0f}) is far from their middle"
        advice = "They belong to images of another size or to a crop: take those of this stream"
        found.append((problem, advice))
    if not all(_FOCAL[0] * width <= focal <= _FOCAL[1] * width for focal in (fx, fy)):
        problem = f"focal lengths of {fx:.0f} and {fy:.0f} px are those of no depth camera"
        found.append((problem, "Give fx and fy in pixels, not in millimetres"))
    elif max(fx / fy, fy / fx) > _RATIO:
        problem = f"fx = {fx:.0f} and fy = {fy:.0f} px are very different"
        found.append((problem, "Check the order of the numbers: fx, fy, cx, cy"))
    where = f"images of {width}x{height}"
    return [Finding("intrinsics", where, problem, advice) for problem, advice in found]


def check_depth_scale(frame: Frame, models: Sequence[ObjectModel]) -> list[Finding]:
    """Depth in another unit: the objects would be too small or too large to be seen."""
    present = frame.depth[frame.depth > 0]
    if not len(present):
        return []
    median, near, far = (float(np.percentile(present, share)) for share in (50, 10, 90))
    focal = float(frame.camera_matrix[0, 0])
    diameters = [model.diameter for model in models]
    if models and (size := focal * max(diameters) / near) < _SMALLEST:
        problem = f"{models[0].name} would be {size:.0f} px large at most"
    elif models and focal * min(diameters) / far > _LARGEST * frame.depth.shape[1]:
        problem = f"{models[0].name} would be larger than the image"
    elif not _USUAL[0] <= median <= _USUAL[1]:
        problem = "few depth cameras measure that"
    else:
        return []
    problem = f"half of the depth is nearer than {median:.3g} m: {problem}"
    advice = "Give depth_scale, in millimetres per unit of the depth images"
    return [Finding("depth scale", "depth images", problem, advice)]


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
