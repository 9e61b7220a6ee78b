"""Progress lines of learning, counted from outside: by what the work asks for.

The fingerprint of what is learnt holds the source of the code that learns it. Lines on a terminal
change nothing of it, so that code does not draw them.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Bool
from tqdm import tqdm

from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.records import Frame, Views


def counting_objects(
    views_of: Callable[[int], Views], what: str, objects: int
) -> Callable[[int], Views]:
    """`views_of`, with a line that counts the objects whose views it was asked for.

    The line begins with the first call and ends with the last of `objects` calls.
    """
    bars: list[tqdm] = []

    def counted(object_id: int) -> Views:
        if not bars:
            bars.append(tqdm(desc=what, total=objects, unit="object", disable=None))
        views = views_of(object_id)
        bars[0].update()
        if bars[0].n == objects:
            bars[0].close()
        return views

    return counted


class CountingEstimator(PoseEstimator):
    """A pose estimator that counts the scenes in which an object's score is calibrated."""

    _bar: tqdm | None = None

    @contextmanager
    def counting(self, name: str, scenes: int) -> Iterator[None]:
        """In the block, every frame that is prepared counts as one of the `scenes` of an object."""
        hidden = None if scenes else True
        with tqdm(desc=f"score of {name}", total=scenes, unit="scene", disable=hidden) as self._bar:
            yield
        self._bar = None

    def prepare(self, frame: Frame, mask: Bool[np.ndarray, "h w"] | None = None) -> FrameContext:
        """See `PoseEstimator.prepare`."""
        if self._bar is not None:
            self._bar.update()
        return super().prepare(frame, mask)
