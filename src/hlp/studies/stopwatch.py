"""Measures the wall time and CPU time of each part of a detection."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from hlp.codebook.neighbours import ExactNeighbours
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.patch_matching import SearchGroup
from hlp.records import LocalPatches

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
    """An observer of a search that adds up the time of each part, from `start` to `stop`.

    No time is lost or counted twice, as long as one thread searches.
    """

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


def load_timed(estimator: PoseEstimator, object_ids: Sequence[int]) -> Loading:
    """Load networks and objects of an estimator that has not been used yet; the time of each."""

    def load_object(object_id: int) -> None:
        estimator.matching.group(object_id)
        estimator.verifier(object_id)

    classifier = _seconds(lambda: estimator.scan)
    encoder = _seconds(lambda: estimator.encoder)
    objects = {object_id: _seconds(partial(load_object, object_id)) for object_id in object_ids}
    return Loading(classifier, encoder, objects)


def compare_searches(
    estimator: PoseEstimator, patches: Mapping[int, LocalPatches]
) -> list[SearchComparison]:
    """Compare each index with an exact search, by the first object that has patches."""
    first: dict[SearchGroup, LocalPatches] = {}
    for object_id, own in patches.items():
        if len(own) > 0:
            first.setdefault(estimator.matching.group(object_id), own)
    return [_compare_search(estimator, group, own) for group, own in first.items()]


def _compare_search(
    estimator: PoseEstimator, group: SearchGroup, patches: LocalPatches
) -> SearchComparison:
    exact = ExactNeighbours(group.features, estimator.settings.coarse.codebook.neighbours)
    queries = estimator.encoder.encode(patches)
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
