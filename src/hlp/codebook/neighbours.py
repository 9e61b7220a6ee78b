"""Nearest neighbours among codebook features: exact, or by randomised kd-trees as in the paper."""

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import torch
from jaxtyping import Float

from hlp.records import Matches

_ROWS = 512  # queries at once: bounds the distance matrix


@dataclass(frozen=True)
class ExactSettings:
    """Exact search; `neighbours` k of each query."""

    name: str
    neighbours: int


@dataclass(frozen=True)
class KdForestSettings:
    """`trees` randomised kd-trees (FLANN), `checks` leaves visited; `neighbours` k."""

    name: str
    neighbours: int
    trees: int
    checks: int


class Neighbours(Protocol):
    """Searches one object's features."""

    def search(self, queries: Float[np.ndarray, "n d"]) -> Matches:
        """The k nearest features of each query, nearest first, Euclidean distances."""


class ExactNeighbours:
    """All distances, by one matrix product per block of queries."""

    def __init__(self, features: Float[np.ndarray, "m d"], neighbours: int) -> None:
        self.features = _single(features)
        self.squares = (self.features**2).sum(dim=1)
        self.neighbours = min(neighbours, len(features))

    def search(self, queries: Float[np.ndarray, "n d"]) -> Matches:
        """The k nearest features of each query, nearest first."""
        indices, distances = [], []
        for block in torch.split(_single(queries), _ROWS):
            # |q − f|² = |q|² + |f|² − 2 q·f; |q|² does not change the order.
            partial = torch.addmm(self.squares, block, self.features.T, alpha=-2.0)
            least, rows = partial.topk(self.neighbours, dim=1, largest=False)
            squared = least + (block**2).sum(dim=1, keepdim=True)
            indices.append(rows)
            distances.append(squared.clamp(min=0.0).sqrt())
        return Matches(torch.cat(indices).numpy(), torch.cat(distances).numpy())


class KdForest:
    """OpenCV's FLANN with randomised kd-trees, seeded: the same features give the same trees."""

    def __init__(
        self,
        features: Float[np.ndarray, "m d"],
        neighbours: int,
        trees: int,
        checks: int,
        seed: int,
    ) -> None:
        # FLANN keeps a pointer: the array must outlive the index.
        self.features = np.ascontiguousarray(features, dtype=np.float32)
        self.neighbours = min(neighbours, len(features))
        self.checks = checks
        cv2.setRNGSeed(seed)
        flann_kd_tree = 1
        self.index = cv2.flann.Index(self.features, {"algorithm": flann_kd_tree, "trees": trees})

    def search(self, queries: Float[np.ndarray, "n d"]) -> Matches:
        """The k approximately nearest features of each query, nearest first."""
        if len(queries) == 0:
            empty = np.zeros((0, self.neighbours))
            return Matches(empty.astype(np.int64), empty.astype(np.float32))
        single = np.ascontiguousarray(queries, dtype=np.float32)
        indices, squared = self.index.knnSearch(
            single, self.neighbours, params={"checks": self.checks}
        )
        return Matches(indices.astype(np.int64), np.sqrt(np.maximum(squared, 0.0)))


def _single(features: Float[np.ndarray, "n d"]) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(features, dtype=np.float32))
