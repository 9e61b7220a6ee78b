"""Measures the wall time and CPU time of each part of a detection."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool

from hlp.codebook.neighbours import ExactNeighbours
from hlp.method.find.estimator import CoarseResult, FrameContext, PoseEstimator
from hlp.method.find.patch_matching import SearchGroup
from hlp.records import Frame, Hypotheses, LocalPatches, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.verification import Observation

PARTS = {
    "windows": 1,
    "network": 1,
    "region": 1,
    "cut": 2,
    "encode": 2,
    "search": 2,
    "vote": 2,
    "modes": 2,
    "screen": 3,
    "refine": 3,
    "verify": 3,
    "polish": 3,
}
"""Parts of detection in their order, each with its stage."""


@dataclass(frozen=True)
class Spent:
    """Wall time and CPU time of all threads of the process (s)."""

    wall: float
    cpu: float


class PartClock:
    """Adds up the time of each part, from `start` to `stop`; none is lost or counted twice."""

    def __init__(self) -> None:
        self._part: str | None = None
        self._begun = (0.0, 0.0)
        self._sums: dict[str, list[float]] = {}

    def start(self) -> None:
        """Reset all times; the clock runs from the first `enter` on."""
        self._sums = {}
        self._part = None

    def enter(self, part: str | None) -> None:
        """Count time for this part from now on; None: for no part."""
        wall, cpu = time.perf_counter(), time.process_time()
        if self._part is not None:
            sums = self._sums.setdefault(self._part, [0.0, 0.0])
            sums[0] += wall - self._begun[0]
            sums[1] += cpu - self._begun[1]
        self._part, self._begun = part, (wall, cpu)

    def stop(self) -> dict[str, Spent]:
        """Time of each part since `start`; parts that were never entered are absent."""
        self.enter(None)
        return {part: Spent(*sums) for part, sums in self._sums.items()}


@dataclass(frozen=True)
class Loading:
    """Seconds to load the networks, and for each object its codebook, index and mesh."""

    classifier: float
    encoder: float
    objects: dict[int, float]


@dataclass(frozen=True)
class SearchComparison:
    """Search of one object's features in its index and by an exact search; times in s.

    `recall` is the share of the exact k nearest entries that were found, `first` the share of the
    queries whose nearest entry was found.
    """

    queries: int
    seconds: float
    exact_seconds: float
    recall: float
    first: float


class TimedEstimator(PoseEstimator):
    """A pose estimator with a clock that measures its parts. Its results are the same."""

    clock: PartClock

    def load_timed(self, object_ids: Sequence[int]) -> Loading:
        """Load networks and objects, and connect their parts to the clock. To be called first."""
        self.clock = PartClock()
        self.clock.start()
        classifier = _seconds(lambda: self._scan)
        encoder = _seconds(lambda: self._encoder)
        objects = {each: _seconds(partial(self._load_object, each)) for each in object_ids}
        self._charge(self._scan.network, "run", "network", "windows")
        self._charge(self._encoder, "encode", "encode", "search")
        for search in {self.matching.group(each).search for each in object_ids}:
            self._charge(search, "search", "search", "vote")
        self._charge(self._modes, "find", "modes", "modes")
        self._charge(self._refiner, "refine", "refine", "verify")
        self._charge(self._refiner, "polish", "polish", "verify")
        return Loading(classifier, encoder, objects)

    def _load_object(self, object_id: int) -> None:
        self.matching.group(object_id)
        self.verifier(object_id)

    def _charge(self, owner: Any, method: str, during: str, after: str) -> None:
        """Make the clock enter `during` as a method of `owner` begins, and `after` as it ends."""
        call = getattr(owner, method)

        def timed(*given: Any, **named: Any) -> Any:
            self.clock.enter(during)
            try:
                return call(*given, **named)
            finally:
                self.clock.enter(after)

        setattr(owner, method, timed)

    def prepare(self, frame: Frame, mask: Bool[np.ndarray, "h w"] | None = None) -> FrameContext:
        """The context of a frame, its windows connected to the clock; see PoseEstimator.prepare."""
        self.clock.enter("windows")
        context = super().prepare(frame, mask)
        self._charge(context.windows, "classify", "windows", "region")
        return context

    def find_region(self, context: FrameContext, object_id: int, instances: int = 1) -> Region:
        """Stage 1; see PoseEstimator.find_region."""
        self.clock.enter("windows")
        return super().find_region(context, object_id, instances)

    def find_hypotheses(self, context: FrameContext, region: Region) -> CoarseResult:
        """Stage 2; see PoseEstimator.find_hypotheses."""
        self.clock.enter("cut")
        return super().find_hypotheses(context, region)

    def refine(
        self,
        context: FrameContext,
        object_id: int,
        hypotheses: Hypotheses,
        instances: int = 1,
        unexplained: Observation | None = None,
        min_score: float | None = None,
    ) -> RefinedHypotheses | None:
        """Stage 3; see PoseEstimator.refine."""
        self.clock.enter("screen")
        return super().refine(context, object_id, hypotheses, instances, unexplained, min_score)

    def entries(self, object_id: int) -> int:
        """Number of the codebook's entries."""
        return len(self.matching.group(object_id).codebooks[object_id].features)

    def compare_searches(self, patches: Mapping[int, LocalPatches]) -> list[SearchComparison]:
        """Compare each index with an exact search, by the first object that has patches."""
        first: dict[SearchGroup, LocalPatches] = {}
        for object_id, own in patches.items():
            if len(own) > 0:
                first.setdefault(self.matching.group(object_id), own)
        return [self._compare_search(group, own) for group, own in first.items()]

    def _compare_search(self, group: SearchGroup, patches: LocalPatches) -> SearchComparison:
        exact = ExactNeighbours(group.features, self.settings.codebook.neighbours)
        queries = self._encoder.encode(patches)
        begun = time.perf_counter()
        found = group.search.search(queries).indices
        middle = time.perf_counter()
        nearest = exact.search(queries).indices
        ended = time.perf_counter()
        right = (found[:, :, None] == nearest[:, None, :]).any(axis=1)
        return SearchComparison(
            len(queries),
            middle - begun,
            ended - middle,
            float(right.mean()),
            float(np.mean(right[:, 0])),
        )


def _seconds(make: Callable[[], object]) -> float:
    begun = time.perf_counter()
    make()
    return time.perf_counter() - begun
