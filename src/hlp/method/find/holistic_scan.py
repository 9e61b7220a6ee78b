"""Stage 1's windows of a frame and their class probabilities, shared between objects."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from hlp.method.find.trace import Observer, nobody
from hlp.models.classifier import CHUNK, class_probabilities
from hlp.models.network import Network
from hlp.patches.holistic import HolisticSettings, RegionSettings, Windows, metric_windows
from hlp.patches.window_choice import (
    Plane,
    SizeGroup,
    checkerboard,
    find_planes,
    group_sizes,
    off_planes,
)
from hlp.patches.window_images import WindowImages
from hlp.records import Frame, ObjectModel
from hlp.threads import ThreadTeam

# Objects whose sizes differ by less share windows, whose scale is then at most 12 % off.
_SHARED_SCALE = 1.25

Classes = Float[np.ndarray, "n classes"]


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
