"""What the numbers in files must mean: rotations, places before a camera, cameras, depths.

Each function raises DataError that begins with `where` and says what is expected.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from hlp.errors import DataError
from hlp.geometry import nearest_rotation

ROTATION_TOLERANCE = 5e-3
"""Largest difference of a stated rotation's numbers from those of the nearest rotation.

Sets that write three digits differ by 0.0017."""
NEAREST, FARTHEST = 0.05, 20.0
"""Distances (m) between which half of a depth image lies."""
_FARTHEST_OBJECT = 100.0  # m
FOCAL = (0.1, 20.0)
"""Focal lengths, in longer sides of the image."""
SKEW = 0.01
"""Largest skew of a camera, in focal lengths: with more it is another matrix."""
_BEYOND_DEPTH = 10.0  # a pose may be that many times nearer or farther than any depth


def require_rotation(
    matrix: Float[np.ndarray, "3 3"], where: str, tolerance: float = ROTATION_TOLERANCE
) -> None:
    """The numbers are those of a rotation, right-handed, up to rounding."""
    left, sizes, right = np.linalg.svd(matrix)
    nearest = left @ right
    if np.abs(nearest - matrix).max() > tolerance:
        raise DataError(
            f"{where} is no rotation: its rows must be of length 1 and at right angles, row by row "
            f"(it scales by {sizes.min():.4g} to {sizes.max():.4g})"
        )
    if np.linalg.det(nearest) < 0:
        raise DataError(
            f"{where} is no rotation but a reflection: take a right-handed coordinate system"
        )


def exact_rotation(
    matrix: Float[np.ndarray, "3 3"], where: str, tolerance: float = ROTATION_TOLERANCE
) -> Float[np.ndarray, "3 3"]:
    """The rotation whose rounded numbers these are."""
    require_rotation(matrix, where, tolerance)
    return nearest_rotation(matrix)


def require_in_front(
    center_cam: Float[np.ndarray, "3"], diameter: float, where: str, unit: str
) -> None:
    """An object of that diameter (m), centred at that point of the camera (m), can be seen.

    `unit` is that of the file.
    """
    depth = float(center_cam[2])
    if depth <= 0:
        raise DataError(
            f"{where} places the object behind the camera ({depth:.4g} m): z must be positive"
        )
    if depth < diameter / 4:
        mistaken = unit != "metres" and depth * 1000 > diameter
        metres = " (are these metres?)" if mistaken else ""
        raise DataError(
            f"{where} places the object of {diameter:.3g} m at {depth:.3g} m, around the camera: "
            f"translations are in {unit}{metres}"
        )
    if float(np.linalg.norm(center_cam)) > _FARTHEST_OBJECT:
        raise DataError(
            f"{where} places the object {float(np.linalg.norm(center_cam)):.4g} m away, at most "
            f"{_FARTHEST_OBJECT:g} m are possible: translations are in {unit}"
        )


def camera_matrix(
    values: Any, where: str, size: tuple[int, int] | None = None
) -> Float[np.ndarray, "3 3"]:
    """Intrinsics of nine numbers, row by row, of images of that size (width, height).

    Without a size, only the matrix itself is checked.
    """
    try:
        matrix = np.asarray(values, dtype=np.float64).reshape(3, 3)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{where} must hold 9 numbers, not {values!r}") from error
    given = matrix.ravel().tolist()
    if not np.isfinite(matrix).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise DataError(f"{where} is {given}: focal lengths must be finite and positive, in pixels")
    rows = np.allclose(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1])
    if not rows or abs(matrix[0, 1]) > SKEW * matrix[0, 0]:
        raise DataError(f"{where} is {given}: it must be fx 0 cx 0 fy cy 0 0 1, row by row")
    if size is None:
        return matrix
    width, height = size
    x, y = float(matrix[0, 2]), float(matrix[1, 2])
    if not (0 <= x < width and 0 <= y < height):
        raise DataError(
            f"{where}: the principal point ({x:.6g}, {y:.6g}) lies outside the image of "
            f"{width}x{height}: are these the intrinsics of images of another size?"
        )
    low, high = (share * max(size) for share in FOCAL)
    for name, focal in (("fx", float(matrix[0, 0])), ("fy", float(matrix[1, 1]))):
        if not low <= focal <= high:
            raise DataError(
                f"{where}: {name} is {focal:.6g} px, in an image of {width}x{height} it must be "
                f"{low:g} to {high:g}: give it in pixels"
            )
    return matrix


def require_depths(metres: Float[np.ndarray, "h w"], where: str) -> None:
    """Half of a depth image (m, 0 where missing) lies at distances that a camera measures."""
    median = float(np.median(metres[metres > 0])) if metres.any() else 0.0
    if not NEAREST <= median <= FARTHEST:
        raise DataError(
            f"{where}: half of the depth is nearer than {median:.3g} m, it must be {NEAREST:g} to "
            f"{FARTHEST:g} m: are these metres, or is depth_scale (mm per unit) wrong?"
        )


def require_near_depths(
    center_cam: Float[np.ndarray, "3"], metres: Float[np.ndarray, "h w"], where: str
) -> None:
    """A true pose lies at a distance like those that the depth image (m) has."""
    present = metres[metres > 0]
    depth, low, high = float(center_cam[2]), float(present.min()), float(present.max())
    if not low / _BEYOND_DEPTH <= depth <= high * _BEYOND_DEPTH:
        raise DataError(
            f"{where} places the object at {depth:.4g} m, but the depth image reaches from "
            f"{low:.4g} to {high:.4g} m: check the unit of the translations and depth_scale"
        )
