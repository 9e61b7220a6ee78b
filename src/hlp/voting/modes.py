"""Modes of the votes: the paper's two independent mean shifts, and the joint 6D modes."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from hlp.geometry import quaternions, rigid, rotation_matrices
from hlp.records import Hypotheses, Votes


@dataclass(frozen=True)
class PaperVotingSettings:
    """Independent mean shifts (paper, section 3.2).

    Flat kernels of `translation_mm` and `rotation_deg` (in quaternion space); `max_distance` is
    Th; `max_votes` the most votes used (the weightiest), `shifts` of the mean at most. A vote's
    weight falls with its match's distance (`weighted`) and grows with the probability of the
    object at its patch (`trusted`); otherwise each counts 1.
    """

    name: str
    max_distance: float
    weighted: bool
    trusted: bool
    translation_mm: float
    rotation_deg: float
    max_votes: int
    shifts: int


@dataclass(frozen=True)
class JointVotingSettings(PaperVotingSettings):
    """Modes of the joint vote: a mode gathers votes that agree in translation and in rotation.

    Beside the keys of `PaperVotingSettings`: up to `hypotheses` modes come out, best first, no two
    within the kernel of each other.
    """

    hypotheses: int


class ModeFinder(Protocol):
    """Finds coarse poses among votes."""

    def find(self, votes: Votes, centroid_obj: Float[np.ndarray, "3"]) -> Hypotheses:
        """Hypotheses, best first; none where there are no votes."""


class PaperModes:
    """Mean shift of translations and of rotations apart; the best centre of each makes the pose."""

    def __init__(self, settings: PaperVotingSettings) -> None:
        self.settings = settings
        self.radius = settings.translation_mm / 1000.0
        self.cosine = float(np.cos(np.deg2rad(settings.rotation_deg) / 2.0))

    def find(self, votes: Votes, centroid_obj: Float[np.ndarray, "3"]) -> Hypotheses:
        """At most one hypothesis: the two centres with most votes."""
        if len(votes) == 0:
            return no_hypotheses()
        centroids, quats, weights = _strongest(votes, self.settings.max_votes)
        near = _within(centroids, self.radius)
        start = centroids[[int(np.argmax(near @ weights))]]
        center = _shift_translations(start, centroids, weights, self.radius, self.settings.shifts)
        alike = np.abs(quats @ quats.T) >= self.cosine
        seed = quats[[int(np.argmax(alike @ weights))]]
        turned = _shift_rotations(seed, quats, weights, self.cosine, self.settings.shifts)
        support = float((near @ weights).max())
        return Hypotheses(_poses(center, turned, centroid_obj), np.array([support]))


class JointModes:
    """Flat-kernel mean shift in translation × rotation from every vote that many agree with."""

    def __init__(self, settings: JointVotingSettings) -> None:
        self.settings = settings
        self.radius = settings.translation_mm / 1000.0
        self.cosine = float(np.cos(np.deg2rad(settings.rotation_deg) / 2.0))

    def find(self, votes: Votes, centroid_obj: Float[np.ndarray, "3"]) -> Hypotheses:
        """Up to `hypotheses` modes, ranked by the weight of the votes within the kernel."""
        if len(votes) == 0:
            return no_hypotheses()
        centroids, quats, weights = _strongest(votes, self.settings.max_votes)
        places, turns = np.ascontiguousarray(centroids.T), np.ascontiguousarray(quats.T)
        support = _supports(places, turns, weights, self.radius**2, self.cosine)
        seeds, inside = self._seeds(places, turns, support)
        centers, turned = centroids[seeds], quats[seeds]
        for _ in range(self.settings.shifts):
            centers = _weighted_mean(inside, weights, centroids)
            turned = _mean_quaternions(inside, weights, quats, turned)
            inside = self._inside(centers, turned, centroids, quats)
        backing = inside @ weights
        order = np.argsort(-backing, kind="stable")
        kept = self._distinct(centers, turned, order)[: self.settings.hypotheses]
        return Hypotheses(_poses(centers[kept], turned[kept], centroid_obj), backing[kept])

    def _seeds(
        self,
        places: Float[np.ndarray, "3 v"],
        turns: Float[np.ndarray, "4 v"],
        support: Float[np.ndarray, "v"],
    ) -> tuple[Int[np.ndarray, "s"], Bool[np.ndarray, "s v"]]:
        """Strongest votes, none within the kernel of a stronger one; a few times what is asked.

        With each, the votes within its kernel.
        """
        seeds: list[int] = []
        inside: list[Bool[np.ndarray, "v"]] = []
        free = support.copy()
        for _ in range(4 * self.settings.hypotheses):
            best = int(np.argmax(free))
            if free[best] < 0.0:
                break
            seeds.append(best)
            inside.append(_agreeing(places, turns, best, self.radius**2, self.cosine))
            free[inside[-1]] = -1.0
        return np.array(seeds), np.array(inside)

    def _inside(
        self,
        centers: Float[np.ndarray, "s 3"],
        turned: Float[np.ndarray, "s 4"],
        centroids: Float[np.ndarray, "v 3"],
        quats: Float[np.ndarray, "v 4"],
    ) -> Bool[np.ndarray, "s v"]:
        apart = _squared_distances(centers, centroids)
        inside = (apart <= self.radius**2) & (np.abs(turned @ quats.T) >= self.cosine)
        # A mean that drifted away from all votes keeps its nearest one.
        lonely = ~inside.any(axis=1)
        inside[lonely, np.argmin(apart[lonely], axis=1)] = True
        return np.asarray(inside)

    def _distinct(
        self,
        centers: Float[np.ndarray, "s 3"],
        turned: Float[np.ndarray, "s 4"],
        order: Int[np.ndarray, "s"],
    ) -> list[int]:
        same = _squared_distances(centers, centers) <= self.radius**2
        same &= np.abs(turned @ turned.T) >= self.cosine
        kept: list[int] = []
        for i in order:
            if not same[i, kept].any():
                kept.append(int(i))
        return kept


# Sums may be taken in another order, as vectors need.
@njit(nogil=True, cache=True, fastmath={"reassoc", "contract", "nsz"})
def _supports(
    places: Float[np.ndarray, "3 v"],
    turns: Float[np.ndarray, "4 v"],
    weights: Float[np.ndarray, "v"],
    reach: float,
    cosine: float,
) -> Float[np.ndarray, "v"]:
    """Weight of the votes within the kernel of each vote; `reach` is the squared radius."""
    count = len(weights)
    support = np.empty(count)
    x, y, z = places[0], places[1], places[2]
    a, b, c, d = turns[0], turns[1], turns[2], turns[3]
    for i in range(count):
        total = 0.0
        for j in range(count):
            apart = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + (z[i] - z[j]) ** 2
            alike = abs(a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + d[i] * d[j])
            total += weights[j] if (apart <= reach) & (alike >= cosine) else 0.0
        support[i] = total
    return support


def _agreeing(
    places: Float[np.ndarray, "3 v"],
    turns: Float[np.ndarray, "4 v"],
    vote: int,
    reach: float,
    cosine: float,
) -> Bool[np.ndarray, "v"]:
    """Which votes lie within the kernel of one."""
    apart = _squared_distances(places[:, [vote]].T, places.T)[0]
    return np.asarray((apart <= reach) & (np.abs(turns[:, vote] @ turns) >= cosine))


def no_hypotheses() -> Hypotheses:
    """What comes of no votes."""
    return Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))


def _strongest(
    votes: Votes, limit: int
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 4"], Float[np.ndarray, "v"]]:
    rows = np.argsort(-votes.weights, kind="stable")[:limit]
    return (
        votes.centroids_cam[rows],
        quaternions(votes.rotations_cam_obj[rows]),
        votes.weights[rows],
    )


def _within(points: Float[np.ndarray, "v 3"], radius: float) -> Bool[np.ndarray, "v v"]:
    squares = (points**2).sum(axis=1)
    apart = squares[:, None] + squares - 2.0 * points @ points.T
    return np.asarray(apart <= radius**2)


def _squared_distances(
    first: Float[np.ndarray, "s 3"], second: Float[np.ndarray, "v 3"]
) -> Float[np.ndarray, "s v"]:
    """Axis by axis: a third of the time of a norm over the last axis."""
    apart = np.zeros((len(first), len(second)))
    for axis in range(3):
        apart += (first[:, axis, None] - second[:, axis]) ** 2
    return apart


def _weighted_mean(
    inside: Bool[np.ndarray, "s v"],
    weights: Float[np.ndarray, "v"],
    values: Float[np.ndarray, "v c"],
) -> Float[np.ndarray, "s c"]:
    shares = inside * weights
    return np.asarray(shares @ values / np.maximum(shares.sum(axis=1), 1e-12)[:, None])


def _mean_quaternions(
    inside: Bool[np.ndarray, "s v"],
    weights: Float[np.ndarray, "v"],
    quats: Float[np.ndarray, "v 4"],
    reference: Float[np.ndarray, "s 4"],
) -> Float[np.ndarray, "s 4"]:
    """Mean of unit quaternions, each flipped to the reference's side: q and −q are one rotation."""
    signs = np.sign(reference @ quats.T)
    total = (inside * weights * np.where(signs == 0, 1.0, signs)) @ quats
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None])


def _shift_translations(
    center: Float[np.ndarray, "s 3"],
    points: Float[np.ndarray, "v 3"],
    weights: Float[np.ndarray, "v"],
    radius: float,
    shifts: int,
) -> Float[np.ndarray, "s 3"]:
    for _ in range(shifts):
        inside = np.linalg.norm(center[:, None] - points, axis=-1) <= radius
        center = _weighted_mean(inside, weights, points)
    return center


def _shift_rotations(
    center: Float[np.ndarray, "s 4"],
    quats: Float[np.ndarray, "v 4"],
    weights: Float[np.ndarray, "v"],
    cosine: float,
    shifts: int,
) -> Float[np.ndarray, "s 4"]:
    for _ in range(shifts):
        inside = np.abs(center @ quats.T) >= cosine
        center = _mean_quaternions(inside, weights, quats, center)
    return center


def _poses(
    centers: Float[np.ndarray, "s 3"],
    quats: Float[np.ndarray, "s 4"],
    centroid_obj: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "s 4 4"]:
    """Poses that put the object's centroid at the centres."""
    rotations = rotation_matrices(quats)
    return rigid(rotations, centers - rotations @ centroid_obj)
