"""Modes of the votes: the paper's independent mean shifts, one after another, or jointly in 6D."""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float

from hlp.arrays import Point, Points, Poses, Values
from hlp.geometry import quaternions, rigid, rotation_matrices
from hlp.kernels import ThreadTeam
from hlp.records import Hypotheses, Votes
from hlp.settings import Count, Doc, NotNegative, Positive, Registry, Settings
from hlp.voting.mean_shift import find_modes

Quaternions = Float[np.ndarray, "n 4"]


class ModeFinder(Protocol):
    """Finds coarse poses among votes."""

    def find(self, votes: Votes, centroid_obj: Point) -> Hypotheses:
        """Hypotheses, best first; none if there are no votes. `centroid_obj` is in metres."""


class VotingSettings(Protocol):
    """Settings of how votes are cast and how their modes are found."""

    @property
    def name(self) -> str:
        """The alternative's name."""

    @property
    def max_distance(self) -> float:
        """Farther matches cast no vote; in units of the codebook's feature scale."""

    @property
    def weighted_by_distance(self) -> bool:
        """Whether a vote's weight falls with its match's distance."""

    @property
    def weighted_by_region(self) -> bool:
        """Whether a vote's weight grows with the object's probability at its patch."""

    def build(self, threads: int) -> ModeFinder:
        """The mode finder. The number of `threads` does not affect results."""


VOTINGS: Registry[VotingSettings] = Registry("voting", "hlp.voting")
"""Alternatives of config group `voting`."""


@dataclass(frozen=True)
class MeanShiftSettings(Settings):
    """What the alternatives have in common, with the paper's values. Kernels are flat."""

    name: str = ""
    max_distance: Annotated[
        NotNegative,
        Doc("T_h (P), in units of the codebook's feature scale; the value is ours (D)"),
    ] = 3.0
    weighted_by_distance: Annotated[
        bool, Doc("votes are weighted by exp(−d²/2σ²), σ the feature scale (D; P: false)")
    ] = False
    weighted_by_region: Annotated[
        bool, Doc("and by the largest p(object) of the windows near the patch (D; P: false)")
    ] = False
    translation_mm: Annotated[Positive, Doc("kernel radius for centroids (P: 10)")] = 10.0
    rotation_deg: Annotated[Positive, Doc("kernel radius for rotations (P: 5)")] = 5.0
    max_votes: Annotated[Count, Doc("largest number of votes used, of largest weight (D)")] = 3000
    mean_shift_iterations: Annotated[
        int, Ge(0), Le(1000), Doc("mean shift steps from each seed (D)")
    ] = 10

    @property
    def radius(self) -> float:
        """Kernel radius for centroids (m)."""
        return self.translation_mm / 1000.0

    @property
    def cosine(self) -> float:
        """Of half the kernel radius for rotations: the least |dot product| of quaternions."""
        return float(np.cos(np.deg2rad(self.rotation_deg) / 2.0))


@VOTINGS.register
@dataclass(frozen=True)
class PaperVotingSettings(MeanShiftSettings):
    """Config group `voting`: independent mean shifts (paper, section 3.2).

    That of rotations is in quaternion space.
    """

    name: Literal["paper"] = "paper"

    def build(self, threads: int) -> "PaperModes":
        """The mode finder; it uses one thread."""
        return PaperModes(self)


@VOTINGS.register
@dataclass(frozen=True)
class SequentialVotingSettings(MeanShiftSettings):
    """Config group `voting`: a mean shift of translations, then one of rotations (D).

    Rotations are those of the votes that agree with the translation found, so that both belong to
    the same pose. The paper's text names two mean shifts and does not say whether the second is
    among all votes.
    """

    name: Literal["sequential"] = "sequential"
    hypotheses: Annotated[
        Count,
        Doc("largest number of translations, of rotations at each, and of coarse poses (P: 1)"),
    ] = 1

    def build(self, threads: int) -> "SequentialModes":
        """The mode finder. The number of `threads` does not affect results."""
        return SequentialModes(self, threads)


@VOTINGS.register
@dataclass(frozen=True)
class JointVotingSettings(MeanShiftSettings):
    """Config group `voting`: modes of the joint 6D vote (D).

    A mode gathers votes that agree in translation and in rotation; no two modes lie within the
    kernel of each other.
    """

    name: Literal["joint"] = "joint"
    weighted_by_distance: Annotated[
        bool, Doc("votes are weighted by exp(−d²/2σ²), σ the feature scale (D)")
    ] = True
    weighted_by_region: Annotated[
        bool, Doc("and by the largest p(object) of the windows near the patch (D)")
    ] = True
    translation_mm: Annotated[Positive, Doc("kernel radius for centroids (D; P: 10)")] = 20.0
    rotation_deg: Annotated[Positive, Doc("kernel radius for rotations (D; P: 5)")] = 18.0
    max_votes: Annotated[Count, Doc("largest number of votes used, of largest weight (D)")] = 1500
    mean_shift_iterations: Annotated[
        int, Ge(0), Le(1000), Doc("mean shift steps from each seed (D)")
    ] = 3
    hypotheses: Annotated[
        Count, Doc("largest number of coarse poses; refinement takes the best fits (D; P: 1)")
    ] = 60

    def build(self, threads: int) -> "JointModes":
        """The mode finder. The number of `threads` does not affect results."""
        return JointModes(self, threads)


class PaperModes:
    """Independent mean shifts of translations and rotations, joined to one pose (paper, 3.2)."""

    def __init__(self, settings: PaperVotingSettings) -> None:
        self.settings = settings

    def find(self, votes: Votes, centroid_obj: Point) -> Hypotheses:
        """At most one hypothesis: the translation mode and the rotation mode with most votes."""
        if len(votes) == 0:
            return _no_hypotheses()
        settings = self.settings
        centroids, quats, weights = _heaviest_votes(votes, settings.max_votes)
        squares = (centroids**2).sum(axis=1)
        squared = squares[:, None] + squares - 2.0 * centroids @ centroids.T
        support = (squared <= settings.radius**2) @ weights
        center = centroids[[int(np.argmax(support))]]
        rotation = quats[[int(np.argmax((np.abs(quats @ quats.T) >= settings.cosine) @ weights))]]
        for _ in range(settings.mean_shift_iterations):
            inside = np.linalg.norm(center[:, None] - centroids, axis=-1) <= settings.radius
            shares = inside * weights
            center = shares @ centroids / np.maximum(shares.sum(axis=1), 1e-12)[:, None]
            dots = rotation @ quats.T
            signs = np.where(dots < 0.0, -1.0, 1.0)  # of q and −q, the nearer one counts
            total = ((np.abs(dots) >= settings.cosine) * weights * signs) @ quats
            rotation = total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None]
        poses = _centred_poses(center, rotation, centroid_obj)
        return Hypotheses(poses, np.array([float(support.max())]))


class SequentialModes:
    """Modes of the centroids; for each, modes of the rotations of the votes that agree with it."""

    def __init__(self, settings: SequentialVotingSettings, threads: int = 1) -> None:
        self.settings = settings
        self._team = ThreadTeam(threads)

    def find(self, votes: Votes, centroid_obj: Point) -> Hypotheses:
        """Up to `hypotheses` poses, those with most votes that agree in both, most first."""
        if len(votes) == 0:
            return _no_hypotheses()
        settings = self.settings
        limits = settings.mean_shift_iterations, settings.hypotheses, self._team
        centroids, quats, weights = _heaviest_votes(votes, settings.max_votes)
        places, _ = find_modes(centroids, quats, weights, settings.radius**2, 0.0, *limits)
        found, supports = [], []
        for place in places:
            distances = np.linalg.norm(centroids - place[:3], axis=1)
            near = distances <= max(settings.radius, float(distances.min()))
            agreeing = centroids[near], quats[near], weights[near]
            turns, support = find_modes(*agreeing, np.inf, settings.cosine, *limits)
            turns[:, :3] = place[:3]
            found.append(turns)
            supports.append(support)
        means, support = np.concatenate(found), np.concatenate(supports)
        order = np.argsort(-support, kind="stable")[: settings.hypotheses]
        poses = _centred_poses(means[order, :3], means[order, 3:], centroid_obj)
        return Hypotheses(poses, support[order])


class JointModes:
    """Mean shift with a flat kernel in translation × rotation, started from votes of high support.

    The result does not depend on the number of `threads`.
    """

    def __init__(self, settings: JointVotingSettings, threads: int = 1) -> None:
        self.settings = settings
        self._team = ThreadTeam(threads)

    def find(self, votes: Votes, centroid_obj: Point) -> Hypotheses:
        """Up to `hypotheses` modes, ordered by the weight of the votes within the kernel."""
        if len(votes) == 0:
            return _no_hypotheses()
        settings = self.settings
        heaviest = _heaviest_votes(votes, settings.max_votes)
        limits = settings.mean_shift_iterations, settings.hypotheses, self._team
        means, support = find_modes(*heaviest, settings.radius**2, settings.cosine, *limits)
        return Hypotheses(_centred_poses(means[:, :3], means[:, 3:], centroid_obj), support)


def _no_hypotheses() -> Hypotheses:
    return Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))


def _heaviest_votes(votes: Votes, limit: int) -> tuple[Points, Quaternions, Values]:
    """Centroids (m), quaternions and weights of the `limit` votes of largest weight."""
    rows = np.argsort(-votes.weights, kind="stable")[:limit]
    rotations = votes.rotations_cam_obj[rows]
    return votes.centroids_cam[rows], quaternions(rotations), votes.weights[rows]


def _centred_poses(centers: Points, quats: Quaternions, centroid_obj: Point) -> Poses:
    """Poses that place the object's centroid at the centres."""
    rotations = rotation_matrices(quats)
    return rigid(rotations, centers - rotations @ centroid_obj)
