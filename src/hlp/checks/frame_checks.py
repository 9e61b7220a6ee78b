"""Whether frames can be read, and what is seen in them alone, without poses or a search."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import Image, Mask, Rgb
from hlp.checks import Finding
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
        frame, kind = None, "files"
        try:
            frame = load(key)
        except HlpError as refusal:
            error = refusal
            if read is not None:
                try:
                    frame, kind = read(key), "values"
                except HlpError as failure:
                    error = failure
            finding = Finding(kind, key, str(error), _ADVICE[kind])
            wrong.setdefault(kind, []).append(finding)
        if frame is not None and number % every == 0:
            frames.append(frame)
    return frames, [finding for findings in wrong.values() for finding in _first(findings)]


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
        found.append(
            (
                f"the principal point ({x:.0f}, {y:.0f}) is far from their middle",
                "They belong to images of another size or to a crop: take those of this stream",
            )
        )
    low, high = _FOCAL[0] * width, _FOCAL[1] * width
    if not (low <= fx <= high and low <= fy <= high):
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
    if models and focal * max(diameters) / near < _SMALLEST:
        size = focal * max(diameters) / near
        problem = f"{models[0].name} would be {size:.0f} px large at most"
    elif models and focal * min(diameters) / far > _LARGEST * frame.depth.shape[1]:
        problem = f"{models[0].name} would be larger than the image"
    elif not _USUAL[0] <= median <= _USUAL[1]:
        problem = "few depth cameras measure that"
    else:
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


_REACH = 16  # px: shifts that are tried in both directions
_ENOUGH = 300  # depth edge pixels of an image; fewer say nothing
_GAP = 8  # px: sensors miss depth next to edges
_JUMP = 0.03  # of the depth, and as many centimetres as below
_LEAST_JUMP = 0.01  # m
_CLEAR = 1.5  # contrast of the best shift, times the mean of all
_NEAR = 4  # px: the best contrast of so small a shift is that of registered images
_LOST = 0.65  # share of the best contrast above the mean that these have less of when unregistered
_TOLERATED = 6.0  # px; cameras that claim to be registered are up to 5 off


def check_registration(frames: Sequence[Frame]) -> list[Finding]:
    """Depth shifted against colour by 6 to 16 px: edges of both should coincide."""
    contrasts = [_contrast_by_shift(frame) for frame in frames]
    known = [contrast for contrast in contrasts if contrast is not None]
    if not known:
        return []
    contrast = np.mean(known, axis=0)
    y, x = np.unravel_index(int(contrast.argmax()), contrast.shape)
    best, mean = contrast[y, x], contrast.mean()
    near = slice(_REACH - _NEAR, _REACH + _NEAR + 1)
    registered = contrast[near, near].max()
    right, down = int(x) - _REACH, int(y) - _REACH
    clear = best > _CLEAR * mean and registered - mean < _LOST * (best - mean)
    if not clear or np.hypot(right, down) < _TOLERATED:
        return []
    problem = f"edges of depth lie on edges of colour when depth is moved by ({right}, {down}) px"
    advice = "Register depth to colour: take the camera's aligned depth stream"
    return [Finding("registration", "depth images", problem, advice)]


def _contrast_by_shift(frame: Frame) -> Float[np.ndarray, "s s"] | None:
    """Mean colour edge strength under the depth edges, for every shift; None if there are few."""
    strength = _color_edges(frame.rgb)
    edges = _depth_edges(frame.depth)
    edges[:_REACH], edges[-_REACH:] = False, False
    edges[:, :_REACH], edges[:, -_REACH:] = False, False
    y, x = np.nonzero(edges)
    if len(y) < _ENOUGH:
        return None
    shifts = range(-_REACH, _REACH + 1)
    return np.array([[strength[y + dy, x + dx].mean() for dx in shifts] for dy in shifts])


def _color_edges(rgb: Rgb) -> Image:
    """Gradient relative to that of the neighbourhood, so that few strong edges do not decide."""
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    relative = gradient / (cv2.boxFilter(gradient, -1, (31, 31)) + 1.0)
    return np.asarray(np.minimum(relative, 4.0))


def _depth_edges(depth: Image) -> Mask:
    """The nearer pixel of every jump in depth, along rows and columns, across small gaps."""
    edges = np.zeros(depth.shape, dtype=bool)
    for values, found in ((depth, edges), (depth.T, edges.T)):
        for line, marked in zip(values, found, strict=True):
            present = np.flatnonzero(line > 0)
            first, second = present[:-1], present[1:]
            near, far = line[first], line[second]
            limit = _JUMP * np.minimum(near, far) + _LEAST_JUMP
            jump = (np.abs(far - near) > limit) & (second - first <= _GAP)
            marked[np.where(near < far, first, second)[jump]] = True
    return edges
