"""Stage 1's windows of a frame and what the classifier says of them, shared between objects."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from hlp.models.classifier import CHUNK, HolisticCNN, class_probabilities, inference_network
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
from hlp.thread_team import ThreadTeam

_APART = 1.25  # sizes that share windows: each object is seen at most 12 % from its own scale

Classes = Float[np.ndarray, "n classes"]


class HolisticScan:
    """Classifies the windows of one frame after another, once for all objects of one size.

    `objects` are those that may be asked for. What is said of a window depends neither on which
    of them are asked for, nor on their order, nor on `threads`.
    """

    def __init__(
        self,
        network: HolisticCNN,
        objects: Mapping[int, ObjectModel],
        holistic: HolisticSettings,
        region: RegionSettings,
        threads: int,
        device: str = "cpu",
    ) -> None:
        self.network = inference_network(network, device)
        self._holistic = holistic
        self._step = region.step
        self._team = ThreadTeam(threads)
        self._fast = region.scan == "fast"
        self._sizes = {i: (model.holistic_size, model.diameter) for i, model in objects.items()}
        self._groups = group_sizes(self._sizes, _APART if self._fast else 1.0)
        self._frame: Frame | None = None
        self._done: dict[SizeGroup, tuple[Windows, Classes]] = {}
        self._planes: list[Plane] | None = None

    def classify(self, frame: Frame, object_id: int) -> tuple[Windows, Classes]:
        """An object's windows and the probabilities of all classes at each."""
        if frame is not self._frame:
            self._frame, self._done, self._planes = frame, {}, None
            self._images = WindowImages(frame.rgb, frame.depth, self._holistic, self._team)
        group = self._groups[object_id]
        if group not in self._done:
            windows = self._windows(frame, group)
            self._done[group] = windows, self._classes(windows, group.metric_size)
        windows, classes = self._done[group]
        scale = self._sizes[object_id][0] / group.metric_size
        return Windows(windows.centers, windows.depths, windows.sides * scale), classes

    def _windows(self, frame: Frame, group: SizeGroup) -> Windows:
        camera = frame.camera_matrix
        windows = metric_windows(frame.depth, camera, group.metric_size, self._step)
        if not self._fast or len(windows.sides) == 0:
            return windows
        if self._planes is None:  # of the frame, whatever the windows' size
            self._planes = find_planes(windows, camera, self._step)
        kept = off_planes(self._planes, len(windows.sides), group.diameter)
        return windows.at(kept & checkerboard(windows.centers, self._step))

    def _classes(self, windows: Windows, metric_size: float) -> Classes:
        # A chunk is cut and classified before the next, while it is in the processor's cache.
        starts = range(0, max(len(windows.sides), 1), CHUNK)
        parts = [windows.at(slice(start, start + CHUNK)) for start in starts]
        images = (self._images.cut(part, metric_size) for part in parts)
        return np.concatenate([class_probabilities(self.network, each) for each in images])
