"""Windows that the classifier can skip (`region.scan: fast`).

Three ways: every other window of the grid, windows on large planes such as a table, and one scan
for objects of nearly equal size. The reference, `region.scan: exact`, classifies all windows.
"""

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from hlp.arrays import CameraMatrix, Flags, Point, Points, Positions, Rows, Values
from hlp.geometry import back_project
from hlp.patches.holistic import Windows, union_of_squares
from hlp.records import Region
from hlp.settings import Count, CountOrNone, Doc, Positive, PositiveOrNone, Settings

_PLANES = 3  # a table, the floor, a wall
_MAX_DISTANCE = 0.010  # m from a plane, within the noise of a depth camera
_MIN_SHARE = 0.05  # of all windows that must lie on a plane
_MIN_NEIGHBOURS = 0.375  # of its neighbours on the plane: rejects thin slices of clutter
_MIN_CLOSE = 0.6  # of its windows within half the distance: a table has nearly all
_MIN_COSINE = 0.1  # of the viewing angle: the area of a plane seen edge-on is unknown
_TRIES = 200
_SAMPLED_POINTS = 300  # points on which the candidate planes are compared


@dataclass(frozen=True)
class SizeGroup:
    """Objects that share windows: the windows' metric size and the largest diameter (m)."""

    metric_size: float
    diameter: float


@dataclass(frozen=True)
class Plane:
    """A plane of the scene: the windows whose centres lie on it, and the area they cover (m²)."""

    windows: Flags
    area: float


def group_sizes(
    objects: Mapping[int, tuple[float, float]], max_ratio: float
) -> dict[int, SizeGroup]:
    """The group of each object id; `objects` gives metric sizes and diameters (m).

    Starting with the smallest, sizes that differ by at most a factor `max_ratio` share their
    geometric mean; with a ratio of 1 only equal sizes share windows.
    """
    groups: dict[int, SizeGroup] = {}
    waiting = sorted(objects, key=lambda object_id: objects[object_id])
    while waiting:
        smallest = objects[waiting[0]][0]
        members = [i for i in waiting if objects[i][0] <= smallest * max_ratio]
        largest = objects[members[-1]][0]
        shared = smallest if largest == smallest else float(np.sqrt(smallest * largest))
        diameter = max(objects[i][1] for i in members)
        groups |= dict.fromkeys(members, SizeGroup(shared, diameter))
        waiting = waiting[len(members) :]
    return groups


def find_planes(windows: Windows, camera_matrix: CameraMatrix, step: int) -> list[Plane]:
    """Up to three planes with the most window centres; windows are `step` px apart."""
    points = back_project(windows.centers, windows.depths, camera_matrix)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    across = (step * windows.depths) ** 2 / (camera_matrix[0, 0] * camera_matrix[1, 1]) * rays[:, 2]
    left = np.ones(len(points), dtype=bool)
    planes: list[Plane] = []
    while len(planes) < _PLANES and left.sum() > max(3, _MIN_SHARE * len(points)):
        normal, offset = _largest_plane(points[left])
        away = np.abs(points @ normal - offset)
        found = left & (away < _MAX_DISTANCE)
        found &= _neighbour_share(windows.centers, found, step) >= _MIN_NEIGHBOURS
        enough = found.sum() > _MIN_SHARE * len(points)
        if not enough or (away[found] < _MAX_DISTANCE / 2).mean() < _MIN_CLOSE:
            break
        facing = np.maximum(np.abs(rays[found] @ normal), _MIN_COSINE)
        planes.append(Plane(found, float((across[found] / facing).sum())))
        left &= ~found
    return planes


def off_planes(planes: Sequence[Plane], count: int, diameter: float) -> Flags:
    """Which of `count` windows lie on no plane larger than the squared `diameter` (m).

    No face of the object can be that large, so the plane must be a support such as a table. Windows
    on parts of the object within a centimetre of the plane are lost as well. Not suitable for
    objects that thin, nor for parts packed so densely that their faces form one plane.
    """
    off = np.ones(count, dtype=bool)
    for plane in planes:
        if plane.area > diameter**2:
            off &= ~plane.windows
    return off


def checkerboard(centers: Positions, step: int) -> Flags:
    """Half of a grid of windows `step` px apart, chosen like the dark squares of a checkerboard."""
    return np.asarray((centers // step).sum(axis=1) % 2 == 0)


def _neighbour_share(centers: Positions, chosen: Flags, step: int) -> Values:
    """Share of chosen windows among the (at most eight) neighbours of each window."""
    x, y = (centers // step).astype(int).T + 1
    grid = np.zeros((2, y.max() + 2, x.max() + 2))
    grid[:, y, x] = chosen, np.ones(len(x))
    near = sum(grid[:, y + j, x + i] for j in (-1, 0, 1) for i in (-1, 0, 1))
    found, there = near - grid[:, y, x]
    return np.asarray(found / np.maximum(there, 1))


def _largest_plane(points: Points) -> tuple[Point, float]:
    """Unit normal n and offset d (m) of the plane n·p = d with most points near it (RANSAC)."""
    corners = points[np.random.default_rng(0).integers(0, len(points), (_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    offsets = (normals * corners[:, 0]).sum(axis=1)
    sample = points[:: max(1, len(points) // _SAMPLED_POINTS)]
    near = (np.abs(sample @ normals.T - offsets) < _MAX_DISTANCE).sum(axis=0)
    near[np.linalg.norm(normals, axis=1) < 0.5] = 0  # three points on a line
    most = int(near.argmax())
    best = np.abs(points @ normals[most] - offsets[most]) < _MAX_DISTANCE
    for _ in range(2):
        middle = points[best].mean(axis=0)
        spread = points[best] - middle
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        best = np.abs((points - middle) @ normal) < _MAX_DISTANCE
    return normal, float(normal @ middle)


_COARSE = 4  # px
_LEAST = 0.02  # p(object): where it is lower, the classifier hardly ever errs
_LEAST_UNKNOWN = 0.15  # the same where the object may be absent: places take time (D)


@dataclass(frozen=True)
class CloserLookSettings(Settings):
    """How much of a region is searched first, and what if that gave no right pose."""

    first_area: Annotated[
        PositiveOrNone,
        Doc(
            "a larger region is searched first in the squares of its likeliest windows, up to this "
            "area (squared diameters; times the instances that are looked for, if their number is "
            "not known) (D); null: the whole region (P)"
        ),
    ] = 6.0

    places: Annotated[
        CountOrNone,
        Doc(
            "likeliest places that are searched if no pose is probably right; all likely ones if "
            "the object is known to be there and has colours (D); null: none (P)"
        ),
    ] = 12
    places_at_once: Annotated[Count, Doc("places that are searched at once (D)")] = 3
    side: Annotated[
        Positive, Doc("side, in diameters, of the square around a place that is searched (D)")
    ] = 1.2


def first_region(
    region: Region,
    radii: Values,
    square_side: float,
    settings: CloserLookSettings,
    instances: int = 1,
) -> Region:
    """The likeliest part of a region that is larger than `first_area` for each of the `instances`.

    As many of the likeliest windows as cover that area by their squares, of `square_side`
    diameters, at least one. `radii` are half the object's diameter in pixels, at the depth of each
    of the region's windows; that of the likeliest window is the unit of the area.
    """
    order = np.argsort(-region.probabilities, kind="stable")
    if settings.first_area is None or len(order) == 0:
        return region
    largest = settings.first_area * instances * (2.0 * radii[order[0]]) ** 2
    if np.count_nonzero(region.mask) <= largest:
        return region
    centers, half_sides = region.centers[order], radii[order] * square_side

    def covered(count: int) -> float:
        """Area (px) of the first squares, measured on a grid of `_COARSE` px."""
        height, width = (-(-side // _COARSE) for side in region.mask.shape)
        # A square covers its last cell as well.
        half = half_sides[:count] / _COARSE - 0.5
        cells = union_of_squares(centers[:count] / _COARSE, half, (height, width))
        return float(np.count_nonzero(cells)) * _COARSE**2

    # The area grows with the number of squares, so that it can be bisected.
    count = bisect_right(range(len(order) + 1), largest, lo=2, key=covered) - 1
    mask = union_of_squares(centers[:count], half_sides[:count], region.mask.shape)
    return replace(region, mask=mask & region.mask)


def likely_regions(
    region: Region, radii: Values, settings: CloserLookSettings, known: bool, everywhere: bool
) -> Iterator[Region]:
    """Regions of a few places each, the likeliest places first.

    `known`: the object is in the image, so that less likely places count, too; `everywhere`: there
    is no limit to their number. `radii` are half the object's diameter in pixels, at the depth of
    each of the region's windows.
    """
    most = len(radii) if everywhere and settings.places else settings.places or 0
    rows = likely_places(region, radii, most, _LEAST if known else _LEAST_UNKNOWN)
    for start in range(0, len(rows), settings.places_at_once):
        chosen = rows[start : start + settings.places_at_once]
        half_sides = radii[chosen] * settings.side
        mask = union_of_squares(region.centers[chosen], half_sides, region.mask.shape)
        yield replace(region, mask=mask)


def likely_places(region: Region, radii: Values, most: int, least: float) -> Rows:
    """The likeliest windows with p(object) > `least`, none within the radius of a likelier one."""
    left = region.probabilities.astype(np.float64)
    rows: list[int] = []
    while len(rows) < most and len(left) and left.max() > least:
        row = int(left.argmax())
        rows.append(row)
        offsets = np.linalg.norm(region.centers - region.centers[row], axis=1)
        left[offsets < radii[row]] = 0.0
    return np.array(rows, dtype=np.int64)
