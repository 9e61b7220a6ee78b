"""Whether intrinsics can be those of the images, and whether depths suit the objects."""

from collections.abc import Sequence

import numpy as np

from hlp.checks.finding import Finding
from hlp.objects.mesh_units import SMALL
from hlp.records import Frame, ObjectModel

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
