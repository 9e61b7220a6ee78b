"""Nearest neighbours by FAISS: inverted lists of short codes, the best candidates compared exactly.

Johnson, Douze & Jégou 2019; 4-bit product codes compared in registers as in André et al. 2017.
"""

from dataclasses import dataclass

import faiss
import numpy as np
from jaxtyping import Float

from hlp.records import Matches

FEWEST = 4096
"""Codebooks of fewer entries are searched exactly: there is nothing to gain."""
_NUMBERS_PER_CODE = 4  # of a feature, behind each 4-bit code


@dataclass(frozen=True)
class InvertedListsSettings:
    """`lists` of entries that lie together, of which the nearest `probes` are searched.

    `candidates` entries for each of the `neighbours` k are compared by their whole features.
    `threads` share out the queries; they change no result.
    """

    name: str
    neighbours: int
    lists: int
    probes: int
    candidates: int
    threads: int


class InvertedLists:
    """FAISS's IVF-PQ with re-ranking. The same features and seed give the same lists."""

    def __init__(
        self, features: Float[np.ndarray, "m d"], settings: InvertedListsSettings, seed: int
    ) -> None:
        single = np.ascontiguousarray(features, dtype=np.float32)
        self.settings = settings
        self.neighbours = min(settings.neighbours, len(single))
        faiss.omp_set_num_threads(1)  # how sums are shared out would decide where lists lie
        self.index = _index(single, settings, seed) if len(single) >= FEWEST else _flat(single)

    def search(self, queries: Float[np.ndarray, "n d"]) -> Matches:
        """The k approximately nearest features of each query, nearest first.

        Distances are exact. Where the lists held fewer entries, the rest are infinitely far.
        """
        if len(queries) == 0:
            empty = np.zeros((0, self.neighbours))
            return Matches(empty.astype(np.int64), empty.astype(np.float32))
        faiss.omp_set_num_threads(self.settings.threads)
        single = np.ascontiguousarray(queries, dtype=np.float32)
        squared, indices = self.index.search(single, self.neighbours)
        distances = np.sqrt(np.maximum(squared, 0.0))
        distances[indices < 0] = np.inf
        return Matches(np.maximum(indices, 0), distances)


def _index(
    features: Float[np.ndarray, "m d"], settings: InvertedListsSettings, seed: int
) -> faiss.IndexRefineFlat:
    """Raises ValueError where features do not divide into codes."""
    dimension = features.shape[1]
    if dimension % _NUMBERS_PER_CODE:
        raise ValueError(
            f"encoder.dimension is {dimension}: codebook=inverted_lists takes multiples of "
            f"{_NUMBERS_PER_CODE}"
        )
    coarse = faiss.IndexFlatL2(dimension)
    short = faiss.IndexIVFPQFastScan(
        coarse, dimension, settings.lists, dimension // _NUMBERS_PER_CODE, 4
    )
    short.cp.seed = short.pq.cp.seed = seed
    short.nprobe = settings.probes
    index = faiss.IndexRefineFlat(short)
    index.k_factor = settings.candidates
    index.train(features)
    index.add(features)
    return index


def _flat(features: Float[np.ndarray, "m d"]) -> faiss.IndexFlatL2:
    index = faiss.IndexFlatL2(features.shape[1])
    index.add(features)
    return index
