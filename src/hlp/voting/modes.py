"""Modes of the votes: the paper's two independent mean shifts, or joint modes in 6D."""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le
from jaxtyping import Bool, Float

from hlp.geometry import quaternions, rigid, rotation_matrices
from hlp.records import Hypotheses, Votes
from hlp.registry import Registry
from hlp.settings import Doc, Settings
from hlp.thread_team import ThreadTeam
from hlp.voting.modes_kernel import choose_distinct, shift_modes, sum_support

_SEEDS_PER_MODE = 4


class ModeFinder(Protocol):
    """Finds coarse poses among votes."""

    def find(self, votes: Votes, centroid_obj: Float[np.ndarray, "3"]) -> Hypotheses:
        """Hypotheses, best first; none if there are no votes. `centroid_obj` is in metres."""


class VotingSettings(Protocol):
    """Settings of how votes are cast and how their modes are found."""

    @property
    def name(self) -> str:
        """The alternative's name."""
        ...

    @property
    def max_distance(self) -> float:
        """Farther matches cast no vote; in units of the codebook's feature scale."""
        ...

    @property
    def weighted_by_distance(self) -> bool:
        """Whether a vote's weight falls with its match's distance."""
        ...

    @property
    def weighted_by_region(self) -> bool:
        """Whether a vote's weight grows with the object's probability at its patch."""
        ...

    def build(self, threads: int) -> ModeFinder:
        """The mode finder. The number of `threads` does not affect results."""
        ...


VOTINGS: Registry[VotingSettings] = Registry("voting", "hlp.voting")
"""Alternatives of config group `voting`."""
MAX_DISTANCE = "T_h (P), in units of the codebook's feature scale; the value is ours (D)"
MAX_VOTES = "largest number of votes used, those of largest weight (D)"


@VOTINGS.register
@dataclass(frozen=True)
class PaperVotingSettings(Settings):
    """Config group `voting`: independent mean shifts (paper, section 3.2).

    Kernels are flat, that of rotations in quaternion space.
    """

    name: Literal["paper"] = "paper"
    max_distance: Annotated[float, Ge(0), Doc(MAX_DISTANCE)] = 3.0
    weighted_by_distance: Annotated[
        bool, Doc("votes are weighted by exp(−d²/2σ²), σ the feature scale (P: false)")
    ] = False
    weighted_by_region: Annotated[
        bool, Doc("and by the largest p(object) of the windows near the patch (P: false)")
    ] = False
    translation_mm: Annotated[float, Gt(0), Doc("kernel radius for centroids (P)")] = 10.0
    rotation_deg: Annotated[float, Gt(0), Doc("kernel radius for rotations (P)")] = 5.0
    max_votes: Annotated[int, Ge(1), Doc(MAX_VOTES)] = 3000
    mean_shift_iterations: Annotated[
        int, Ge(0), Le(1000), Doc("largest number of mean shift steps (D)")
    ] = 10

    def build(self, threads: int) -> "PaperModes":
        """The mode finder; it uses one thread."""
        return PaperModes(self)


@VOTINGS.register
@dataclass(frozen=True)
class JointVotingSettings(Settings):
    """Config group `voting`: modes of the joint 6D vote.

    A mode gathers votes that agree in translation and in rotation; no two modes lie within the
    kernel of each other. Kernels are flat.
    """

    name: Literal["joint"] = "joint"
    max_distance: Annotated[float, Ge(0), Doc(MAX_DISTANCE)] = 3.0
    weighted_by_distance: Annotated[
        bool, Doc("votes are weighted by exp(−d²/2σ²), σ the feature scale (D)")
    ] = True
    weighted_by_region: Annotated[
        bool, Doc("and by the largest p(object) of the windows near the patch (D)")
    ] = True
    translation_mm: Annotated[float, Gt(0), Doc("kernel radius for centroids (D; P: 10)")] = 20.0
    rotation_deg: Annotated[float, Gt(0), Doc("kernel radius for rotations (D; P: 5)")] = 18.0
    max_votes: Annotated[int, Ge(1), Doc(MAX_VOTES)] = 1500
    mean_shift_iterations: Annotated[
        int, Ge(0), Le(1000), Doc("mean shift steps from each seed (D)")
    ] = 3
    hypotheses: Annotated[
        int,
        Ge(1),
        Doc("largest number of coarse poses; refinement takes the best fits (D; P: 1)"),
    ] = 60

    def build(self, threads: int) -> "JointModes":
        """The mode finder. The number of `threads` does not affect results."""
        return JointModes(self, threads)


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
        centroids, quats, weights = heaviest_votes(votes, self.settings.max_votes)
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
        return Hypotheses(centred_poses(center, rotation, centroid_obj), np.array([support]))


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
        settings = self.settings
        means, support = find_modes(
            *heaviest_votes(votes, settings.max_votes),
            self.radius_squared,
            self.cosine,
            settings.mean_shift_iterations,
            settings.hypotheses,
            self._team,
        )
        return Hypotheses(centred_poses(means[:, :3], means[:, 3:], centroid_obj), support)


def find_modes(
    centroids: Float[np.ndarray, "v 3"],
    quats: Float[np.ndarray, "v 4"],
    weights: Float[np.ndarray, "v"],
    radius_squared: float,
    cosine: float,
    steps: int,
    limit: int,
    team: ThreadTeam,
) -> tuple[Float[np.ndarray, "m 7"], Float[np.ndarray, "m"]]:
    """At most `limit` distinct modes (centroid, quaternion) of votes, and the weight at each.

    Votes agree within `radius_squared` (m²) and a `cosine` of half the angle; with a cosine of 0
    rotations do not matter, with an infinite radius centroids do not. The mode of most weight comes
    first. Each mean shift takes as many `steps`.
    """
    columns = np.ascontiguousarray(centroids.T), np.ascontiguousarray(quats.T)
    grouped_votes = (*columns, weights, radius_squared, cosine)
    support = np.empty(len(weights))
    team.map_ranges(lambda a, b: sum_support(*grouped_votes, a, support[a:b]), len(support))
    # More seeds than requested modes, because several may shift to the same mode.
    seeds = choose_distinct(*columns, support, radius_squared, cosine, _SEEDS_PER_MODE * limit)
    means, mode_support = np.hstack([centroids[seeds], quats[seeds]]), np.empty(len(seeds))
    team.map_ranges(
        lambda a, b: shift_modes(*grouped_votes, steps, means[a:b], mode_support[a:b]),
        len(seeds),
    )
    modes = (np.ascontiguousarray(means[:, :3].T), np.ascontiguousarray(means[:, 3:].T))
    kept = choose_distinct(*modes, mode_support, radius_squared, cosine, limit)
    return means[kept], mode_support[kept]


def no_hypotheses() -> Hypotheses:
    """Hypotheses without any pose."""
    return Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))


def heaviest_votes(
    votes: Votes, limit: int
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 4"], Float[np.ndarray, "v"]]:
    """Centroids (m), quaternions and weights of the `limit` votes of largest weight."""
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


def centred_poses(
    centers: Float[np.ndarray, "s 3"],
    quats: Float[np.ndarray, "s 4"],
    centroid_obj: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "s 4 4"]:
    """Poses that place the object's centroid at the centres."""
    rotations = rotation_matrices(quats)
    return rigid(rotations, centers - rotations @ centroid_obj)
