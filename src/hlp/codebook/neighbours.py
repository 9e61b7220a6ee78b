"""Nearest neighbours among codebook features: exact, or by randomised kd-trees (paper)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Protocol

import cv2
import numpy as np
from annotated_types import Le
from jaxtyping import Float, Int

from hlp.arrays import Features, Values
from hlp.records import Matches
from hlp.settings import Count, Doc, Named, Registry, Settings

_ROWS = 128  # queries in a block: bounds the distance matrix


class Neighbours(Protocol):
    """Searches the features of one object, or of several at once."""

    def search(self, queries: Features) -> Matches:
        """The k nearest features of each query, nearest first, with Euclidean distances."""


class NeighboursSettings(Named, Protocol):
    """Settings of the search in a codebook."""

    dimension_multiple: ClassVar[int]
    """The length of features must be a multiple of this."""

    @property
    def neighbours(self) -> int:
        """Number of nearest features that are found for each query."""

    def build(
        self, features: Features, seed: int, threads: int, folder: Path | None = None
    ) -> Neighbours:
        """The search among these features. The number of `threads` does not affect results.

        `folder` is the one given to `prepare` for these features (None: nothing was prepared).
        """

    def prepare(self, features: Features, seed: int, folder: Path) -> None:
        """Write into a folder whatever takes long to build, if anything."""


def is_joint(settings: NeighboursSettings) -> bool:
    """Whether objects whose patches have one size are searched at once: `joint`, if it is set."""
    return bool(getattr(settings, "joint", False))


SEARCHES: Registry[NeighboursSettings] = Registry("codebook", "hlp.codebook")
"""Alternatives of config group `codebook`."""


@dataclass(frozen=True)
class SearchSettings(Settings):
    """What the alternatives have in common."""

    name: str = ""
    neighbours: Annotated[
        Count, Le(1000), Doc("nearest entries of each patch that vote (P: k = 3)")
    ] = 3

    dimension_multiple: ClassVar[int] = 1

    def prepare(self, features: Features, seed: int, folder: Path) -> None:
        """Nothing takes long, unless an alternative says otherwise."""


@SEARCHES.register
@dataclass(frozen=True)
class ExactSettings(SearchSettings):
    """Config group `codebook`: exact search."""

    name: Literal["exact"] = "exact"

    def build(
        self, features: Features, seed: int, threads: int, folder: Path | None = None
    ) -> "ExactNeighbours":
        """Exact search. `threads` is not used: BLAS has its own threads."""
        return ExactNeighbours(features, self.neighbours)


@SEARCHES.register
@dataclass(frozen=True)
class KdForestSettings(SearchSettings):
    """Config group `codebook`: randomised kd-trees (FLANN), the paper's."""

    name: Literal["kd_forest"] = "kd_forest"
    trees: Annotated[Count, Le(100), Doc("randomised trees (P)")] = 4
    checks: Annotated[Count, Doc("leaves visited for one query (D)")] = 256

    def build(
        self, features: Features, seed: int, threads: int, folder: Path | None = None
    ) -> "KdForest":
        """The trees, built with the seed. They are searched in one thread."""
        return KdForest(features, self.neighbours, self.trees, self.checks, seed)


class ExactNeighbours:
    """Exact search: all distances, by one matrix product for each block of queries."""

    def __init__(self, features: Features, neighbours: int) -> None:
        self.features = np.ascontiguousarray(features, dtype=np.float32)
        self.squares = np.einsum("md,md->m", self.features, self.features)
        self.neighbours = min(neighbours, len(features))

    def search(self, queries: Features) -> Matches:
        """The k nearest features of each query, nearest first."""
        single = np.ascontiguousarray(queries, dtype=np.float32)
        indices = np.empty((len(single), self.neighbours), dtype=np.int64)
        distances = np.empty(indices.shape, dtype=np.float32)
        for start in range(0, len(single), _ROWS):
            block, rows = single[start : start + _ROWS], slice(start, start + _ROWS)
            indices[rows] = _least(self._partial_squares(block), self.neighbours)
            # Once more, exactly: the sums of BLAS depend on the queries beside this one.
            apart = block[:, None] - self.features[indices[rows]]
            distances[rows] = np.sqrt(np.einsum("nkd,nkd->nk", apart, apart))
        return Matches(indices, distances)

    def nearest_distances(self, queries: Features) -> Values:
        """The distance of each query to its nearest feature, to single precision of the squares."""
        distances = np.empty(len(queries), dtype=np.float32)
        for start in range(0, len(queries), _ROWS):
            block, rows = queries[start : start + _ROWS], slice(start, start + _ROWS)
            squared = self._partial_squares(block).min(axis=1) + np.einsum("nd,nd->n", block, block)
            distances[rows] = np.sqrt(np.maximum(squared, 0.0))
        return distances

    def _partial_squares(self, block: Features) -> Float[np.ndarray, "n m"]:
        """|q − f|² = |q|² + |f|² − 2 q·f without |q|², which does not change a query's order."""
        partial = block @ self.features.T
        partial *= np.float32(-2.0)
        partial += self.squares
        return np.asarray(partial)


class KdForest:
    """OpenCV's FLANN with randomised kd-trees. The same features and seed give the same trees."""

    def __init__(
        self, features: Features, neighbours: int, trees: int, checks: int, seed: int
    ) -> None:
        # FLANN keeps a pointer: the array must outlive the index.
        self.features = np.ascontiguousarray(features, dtype=np.float32)
        self.neighbours = min(neighbours, len(features))
        self.checks = checks
        cv2.setRNGSeed(seed)
        flann_kd_tree = 1
        self.index = cv2.flann.Index(self.features, {"algorithm": flann_kd_tree, "trees": trees})

    def search(self, queries: Features) -> Matches:
        """The k approximately nearest features of each query, nearest first."""
        if len(queries) == 0:
            empty = np.zeros((0, self.neighbours))
            return Matches(empty.astype(np.int64), empty.astype(np.float32))
        single = np.ascontiguousarray(queries, dtype=np.float32)
        indices, squared = self.index.knnSearch(
            single, self.neighbours, params={"checks": self.checks}
        )
        return Matches(indices.astype(np.int64), np.sqrt(np.maximum(squared, 0.0)))


def _least(values: Float[np.ndarray, "n m"], count: int) -> Int[np.ndarray, "n k"]:
    """Columns of the `count` least values of each row, the least first."""
    if count < values.shape[1]:
        found = np.argpartition(values, count - 1, axis=1)[:, :count]
    else:
        found = np.broadcast_to(np.arange(count), values.shape)
    order = np.argsort(np.take_along_axis(values, found, axis=1), axis=1, kind="stable")
    return np.asarray(np.take_along_axis(found, order, axis=1))
