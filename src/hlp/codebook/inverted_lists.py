"""Nearest neighbours by FAISS: inverted lists of short codes; the best candidates compared exactly.

Johnson, Douze & Jégou 2019, with 4-bit product codes compared in registers (André et al. 2017).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Le
from jaxtyping import Float32, Int64, UInt8

from hlp.arrays import Features
from hlp.codebook.neighbours import SEARCHES, ExactNeighbours, SearchSettings
from hlp.errors import DataError
from hlp.files import read_npz
from hlp.kernels import compiled, compiled_ahead
from hlp.records import Matches
from hlp.settings import Count, Doc
from hlp.threads import ThreadTeam, threads_here

if TYPE_CHECKING:
    import faiss

EXACT_BELOW = 4096
"""Codebooks with fewer entries are searched exactly, which is just as fast."""
_FILE = "lists.npz"
_ENTRIES = 450  # in a list
_NUMBERS_PER_CODE = 4  # numbers of a feature that one 4-bit code stands for


Bytes = UInt8[np.ndarray, "bytes"]


@dataclass(frozen=True)
class ListsSettings(SearchSettings):
    """What inverted lists of one object's entries, or of all objects', have in common."""

    lists: Annotated[
        Count, Doc(f"number of lists; with 57,600 entries, each holds about {_ENTRIES} (D)")
    ] = 128
    probes: Annotated[Count, Doc("number of nearest lists that are searched (D)")] = 16
    candidates: Annotated[
        Count, Doc("entries compared by their whole features, for each neighbour (D)")
    ] = 16

    dimension_multiple: ClassVar[int] = _NUMBERS_PER_CODE

    def build(
        self, features: Features, seed: int, threads: int, folder: Path | None = None
    ) -> InvertedLists:
        """The lists, read from the folder if it holds them, otherwise trained with the seed."""
        settings = self.for_entries(len(features))
        trained = None if folder is None else load_lists(folder, settings, seed)
        return InvertedLists(features, settings, seed, trained, threads)

    def prepare(self, features: Features, seed: int, folder: Path) -> None:
        """Train the lists and write them into the folder."""
        searched = InvertedLists(features, self.for_entries(len(features)), seed)
        lists = searched.settings.lists
        np.savez(folder / _FILE, trained=searched.trained, lists=lists, seed=seed)

    def for_entries(self, entries: int) -> ListsSettings:
        """The settings for so many entries."""
        return self


@SEARCHES.register
@dataclass(frozen=True)
class InvertedListsSettings(ListsSettings):
    """Config group `codebook`: FAISS's inverted lists of short codes (D)."""

    name: Literal["inverted_lists"] = "inverted_lists"


@SEARCHES.register
@dataclass(frozen=True)
class JointListsSettings(ListsSettings):
    """Config group `codebook`: inverted lists of all objects whose patches have one size (D).

    A patch is looked up once and votes for the objects of its nearest entries alone: one that shows
    an object hardly ever votes for another. Set `patches.local.size_mm`, so that the patches of all
    objects have one size; otherwise only objects that happen to have the same size share an index.
    """

    name: Literal["joint_lists"] = "joint_lists"
    neighbours: Annotated[
        Count, Le(1000), Doc("nearest entries, of any object, of each patch that vote (D)")
    ] = 3
    lists: Annotated[
        Count, Doc(f"largest number of lists; with fewer entries there is one for {_ENTRIES} (D)")
    ] = 1024
    candidates: Annotated[
        Count, Doc("entries compared by their whole features, for each neighbour (D)")
    ] = 8

    joint: ClassVar[bool] = True

    def for_entries(self, entries: int) -> ListsSettings:
        """The settings for so many entries."""
        return replace(self, lists=min(self.lists, max(entries // _ENTRIES, 1)))


class InvertedLists:
    """FAISS's IVF-PQ; the best candidates are compared by their whole features.

    The same features and seed give the same lists. `trained` is the attribute `trained` of another
    instance with the same features, settings and seed; with it, nothing is trained again. The
    number of `threads` does not affect results.
    """

    def __init__(
        self,
        features: Features,
        settings: ListsSettings,
        seed: int,
        trained: Bytes | None = None,
        threads: int = 1,
    ) -> None:
        self.features = np.ascontiguousarray(features, dtype=np.float32)
        self.settings = settings
        self._threads = threads
        self.neighbours = min(settings.neighbours, len(self.features))
        self._team = ThreadTeam(threads)
        self._lists: Any = None
        if len(self.features) >= EXACT_BELOW:
            if trained is None:
                self._lists = _train(self.features, settings, seed)
            else:
                self._lists = _restore(trained, self.features, settings)
            self._lists.nprobe = settings.probes

    @property
    def trained(self) -> Bytes:
        """The lists as bytes for a file; empty if the codebook is searched exactly."""
        if self._lists is None:
            return np.zeros(0, dtype=np.uint8)
        import faiss

        return np.asarray(faiss.serialize_index(self._lists))

    def search(self, queries: Features) -> Matches:
        """The k approximately nearest features of each query, nearest first.

        Distances are exact. If the searched lists hold fewer than k entries, the rest are at an
        infinite distance.
        """
        single = np.ascontiguousarray(queries, dtype=np.float32)
        if self._lists is None:
            return ExactNeighbours(self.features, self.neighbours).search(single)
        indices = np.zeros((len(single), self.neighbours), dtype=np.int64)
        squared = np.full(indices.shape, np.inf, dtype=np.float32)
        if len(single):
            import faiss

            faiss.omp_set_num_threads(threads_here(self._threads))
            count = self.neighbours * self.settings.candidates
            _, candidates = self._lists.search(single, count)

            def compare(first: int, last: int) -> None:
                parts = (array[first:last] for array in (single, candidates, indices, squared))
                _nearest(self.features, *parts)

            self._team.map_ranges(compare, len(single))
        return Matches(indices, np.sqrt(squared))


def load_lists(folder: Path, settings: ListsSettings, seed: int) -> Bytes | None:
    """The lists that `ListsSettings.prepare` wrote; None if there are none for these settings."""
    if not (folder / _FILE).is_file():
        return None
    stored = read_npz(folder / _FILE)
    made_for = int(stored["lists"]), int(stored["seed"])
    fits = made_for == (settings.lists, seed) and stored["trained"].size
    return stored["trained"] if fits else None


def _train(features: Features, settings: ListsSettings, seed: int) -> faiss.IndexIVFPQFastScan:
    import faiss

    faiss.omp_set_num_threads(1)  # more threads would change the order of sums, and so the lists
    dimension = features.shape[1]
    coarse = faiss.IndexFlatL2(dimension)
    lists = faiss.IndexIVFPQFastScan(
        coarse, dimension, settings.lists, dimension // _NUMBERS_PER_CODE, 4
    )
    lists.cp.seed = lists.pq.cp.seed = seed
    lists.train(features)
    lists.add(features)
    return lists


def _restore(trained: Bytes, features: Features, settings: ListsSettings) -> faiss.Index:
    """Raises DataError if the bytes are not the lists of these features and settings."""
    import faiss

    try:
        lists = faiss.deserialize_index(trained)
    except RuntimeError as error:
        raise DataError(f"the stored lists of a codebook are damaged ({error})") from error
    found = (type(lists), lists.d, lists.ntotal, getattr(lists, "nlist", None))
    expected = (faiss.IndexIVFPQFastScan, features.shape[1], len(features), settings.lists)
    if found != expected:
        raise DataError("the stored lists of a codebook are those of other features or settings")
    return lists


@compiled_ahead()
def _nearest(
    features: Float32[np.ndarray, "m d"],
    queries: Float32[np.ndarray, "n d"],
    candidates: Int64[np.ndarray, "n c"],
    indices: Int64[np.ndarray, "n k"],
    squared: Float32[np.ndarray, "n k"],
) -> None:
    """The nearest of each query's candidates by their whole features; -1 means none."""
    for i in range(len(queries)):
        for candidate in candidates[i]:
            if candidate < 0:
                continue
            distance = _squared_distance(queries[i], features[candidate])
            place = squared.shape[1]
            while place > 0 and distance < squared[i, place - 1]:
                place -= 1
                if place + 1 < squared.shape[1]:
                    squared[i, place + 1] = squared[i, place]
                    indices[i, place + 1] = indices[i, place]
            if place < squared.shape[1]:
                squared[i, place] = distance
                indices[i, place] = candidate


@compiled(fastmath={"reassoc"})
def _squared_distance(a: Float32[np.ndarray, "d"], b: Float32[np.ndarray, "d"]) -> np.float32:
    total = np.float32(0)
    for c in range(len(a)):
        total += (a[c] - b[c]) * (a[c] - b[c])
    return total
