"""Stage 1's windows of a frame and their class probabilities, shared between objects.

Some windows can be skipped (`region.scan: fast`), in three ways: every other window of the grid,
windows on large planes such as a table, and one scan for objects of nearly equal size. The
reference, `region.scan: exact`, classifies all windows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hlp.arrays import CameraMatrix, Flags, Point, Points, Positions, Values
from hlp.geometry import back_project
from hlp.method.find.trace import Observer, nobody
from hlp.models.classifier import CHUNK, class_probabilities
from hlp.models.network import Network
from hlp.patches.holistic import HolisticSettings, Windows, metric_windows
from hlp.patches.region import RegionSettings
from hlp.patches.window_images import WindowImages
from hlp.records import Frame, ObjectModel
from hlp.threads import ThreadTeam

Classes = Float[np.ndarray, "n classes"]
_SHARED_SCALE = 1.25  # between sizes that share windows, whose scale is then at most 12 % off
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


class HolisticScan:
    """Classifies the windows of frames, once for all objects of about one size.

    `objects` are those that may be requested. The probabilities at a window depend neither on
    which of them are requested, nor on their order, nor on `threads`.
    """

    def __init__(
        self,
        network: Network,
        objects: Mapping[int, ObjectModel],
        holistic: HolisticSettings,
        region: RegionSettings,
        threads: int,
    ) -> None:
        self.network, self.holistic, self.step = network, holistic, region.step
        self.team = ThreadTeam(threads)
        self.fast = region.scan == "fast"
        self.sizes = {i: (model.holistic_size, model.diameter) for i, model in objects.items()}
        self.groups = group_sizes(self.sizes, _SHARED_SCALE if self.fast else 1.0)


class FrameWindows:
    """The windows of one frame, classified when an object of their size is first requested."""

    def __init__(self, scan: HolisticScan, frame: Frame, observer: Observer = nobody) -> None:
        self._scan, self._frame, self._observer = scan, frame, observer
        self._images = WindowImages(frame.rgb, frame.depth, scan.holistic, scan.team)
        self._classified: dict[SizeGroup, tuple[Windows, Classes]] = {}
        self._planes: list[Plane] | None = None

    def classify(self, object_id: int) -> tuple[Windows, Classes]:
        """An object's windows and the probabilities of all classes at each."""
        self._observer("windows")
        group = self._scan.groups[object_id]
        if group not in self._classified:
            windows = self._windows(group)
            self._classified[group] = windows, self._classes(windows, group.metric_size)
        windows, classes = self._classified[group]
        scale = self._scan.sizes[object_id][0] / group.metric_size
        return Windows(windows.centers, windows.depths, windows.sides * scale), classes

    def _windows(self, group: SizeGroup) -> Windows:
        camera, step = self._frame.camera_matrix, self._scan.step
        windows = metric_windows(self._frame.depth, camera, group.metric_size, step)
        if not self._scan.fast or len(windows.sides) == 0:
            return windows
        if self._planes is None:  # the same for windows of any size
            self._planes = find_planes(windows, camera, step)
        kept = off_planes(self._planes, len(windows.sides), group.diameter)
        return windows.at(kept & checkerboard(windows.centers, step))

    def _classes(self, windows: Windows, metric_size: float) -> Classes:
        # Each chunk is cut and then classified while it is still in the processor's cache.
        classes = []
        for start in range(0, max(len(windows.sides), 1), CHUNK):
            self._observer("windows")
            part = windows.at(slice(start, start + CHUNK))
            images = self._images.cut(part, metric_size)
            self._observer("network")
            classes.append(class_probabilities(self._scan.network, images))
        return np.concatenate(classes)


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
