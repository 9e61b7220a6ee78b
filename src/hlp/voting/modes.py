"""Modes of the votes: the paper's two independent mean shifts, or joint modes in 6D."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float

from hlp.geometry import quaternions, rigid, rotation_matrices
from hlp.records import Hypotheses, Votes
from hlp.thread_team import ThreadTeam
from hlp.voting.modes_kernel import choose_distinct, shift_modes, sum_support

_SEEDS_PER_MODE = 4


@dataclass(frozen=True)
class PaperVotingSettings:
    """Independent mean shifts (paper, section 3.2).

    Flat kernels of `translation_mm` and `rotation_deg` (in quaternion space); `max_distance` is
    Th; `max_votes` the most votes used (the weightiest), `mean_shift_iterations` steps of mean shift at most. A vote's
    weight falls with its match's distance (`weighted_by_distance`) and grows with the probability of the
    object at its patch (`weighted_by_region`); otherwise each counts 1.
    """

    name: str
    max_distance: float
    weighted_by_distance: bool
    weighted_by_region: bool
    translation_mm: float
    rotation_deg: float
    max_votes: int
    mean_shift_iterations: int


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
        """Hypotheses, best first; none if there are no votes. `centroid_obj` is in metres."""


class PaperModes:
    """Independent mean shifts of translations and rotations, joined to one pose (paper, 3.2)."""

    def __init__(self, settings: PaperVotingSettings) -> None:
        self.settings = settings
        self.radius = settings.translation_mm / 1000.0
        self.cosine = float(np.cos(np.deg2rad(settings.rotation_deg) / 2.0))

    def find(self, votes: Votes, centroid_obj: Float[np.ndarray, "3"]) -> Hypotheses:
        """At most one hypothesis: the translation mode and the rotation mode with most votes."""
        if len(votes) == 0:
            return no_hypotheses()
        centroids, quats, weights = _heaviest(votes, self.settings.max_votes)
        near = _within(centroids, self.radius)
        start = centroids[[int(np.argmax(near @ weights))]]
        center = _shift_translations(
            start, centroids, weights, self.radius, self.settings.mean_shift_iterations
        )
        similar = np.abs(quats @ quats.T) >= self.cosine
        seed = quats[[int(np.argmax(similar @ weights))]]
        rotation = _shift_rotations(
            seed, quats, weights, self.cosine, self.settings.mean_shift_iterations
        )
        support = float((near @ weights).max())
        return Hypotheses(_poses(center, rotation, centroid_obj), np.array([support]))


class JointModes:
    """Mean shift with a flat kernel in translation × rotation, started from votes of high support.

    The result does not depend on the number of `threads`.
    """

    def __init__(self, settings: JointVotingSettings, threads: int = 1) -> None:
        self.settings = settings
        self.radius_squared = (settings.translation_mm / 1000.0) ** 2
        self.cosine = float(np.cos(np.deg2rad(settings.rotation_deg) / 2.0))
        self._team = ThreadTeam(threads)

    def find(self, votes: Votes, centroid_obj: Float[np.ndarray, "3"]) -> Hypotheses:
        """Up to `hypotheses` modes, ordered by the weight of the votes within the kernel."""
        if len(votes) == 0:
            return no_hypotheses()
        centroids, quats, weights = _heaviest(votes, self.settings.max_votes)
        columns = np.ascontiguousarray(centroids.T), np.ascontiguousarray(quats.T)
        grouped_votes = (*columns, weights, self.radius_squared, self.cosine)
        support = np.empty(len(weights))
        self._team.map_ranges(
            lambda a, b: sum_support(*grouped_votes, a, support[a:b]), len(support)
        )
        # More seeds than modes wanted, because several may shift to the same mode.
        limit = _SEEDS_PER_MODE * self.settings.hypotheses
        seeds = choose_distinct(*columns, support, self.radius_squared, self.cosine, limit)
        means, mode_support = np.hstack([centroids[seeds], quats[seeds]]), np.empty(len(seeds))
        steps = self.settings.mean_shift_iterations
        self._team.map_ranges(
            lambda a, b: shift_modes(*grouped_votes, steps, means[a:b], mode_support[a:b]),
            len(seeds),
        )
        modes = (np.ascontiguousarray(means[:, :3].T), np.ascontiguousarray(means[:, 3:].T))
        limit = self.settings.hypotheses
        kept = choose_distinct(*modes, mode_support, self.radius_squared, self.cosine, limit)
        poses = _poses(means[kept, :3], means[kept, 3:], centroid_obj)
        return Hypotheses(poses, mode_support[kept])


def no_hypotheses() -> Hypotheses:
    """Hypotheses without any pose."""
    return Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))


def _heaviest(
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
    distances = squares[:, None] + squares - 2.0 * points @ points.T
    return np.asarray(distances <= radius**2)


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
    """Mean unit quaternions, each q or −q, whichever is nearer to the reference."""
    signs = np.sign(reference @ quats.T)
    total = (inside * weights * np.where(signs == 0, 1.0, signs)) @ quats
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None])


def _shift_translations(
    center: Float[np.ndarray, "s 3"],
    points: Float[np.ndarray, "v 3"],
    weights: Float[np.ndarray, "v"],
    radius: float,
    steps: int,
) -> Float[np.ndarray, "s 3"]:
    for _ in range(steps):
        inside = np.linalg.norm(center[:, None] - points, axis=-1) <= radius
        center = _weighted_mean(inside, weights, points)
    return center


def _shift_rotations(
    center: Float[np.ndarray, "s 4"],
    quats: Float[np.ndarray, "v 4"],
    weights: Float[np.ndarray, "v"],
    cosine: float,
    steps: int,
) -> Float[np.ndarray, "s 4"]:
    for _ in range(steps):
        inside = np.abs(center @ quats.T) >= cosine
        center = _mean_quaternions(inside, weights, quats, center)
    return center


def _poses(
    centers: Float[np.ndarray, "s 3"],
    quats: Float[np.ndarray, "s 4"],
    centroid_obj: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "s 4 4"]:
    """Poses that place the object's centroid at the centres."""
    rotations = rotation_matrices(quats)
    return rigid(rotations, centers - rotations @ centroid_obj)
