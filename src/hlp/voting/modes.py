"""Modes of the votes: the paper's independent mean shifts, one after another, or jointly in 6D."""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Le
from jaxtyping import Float

from hlp.arrays import Point, Points, Values
from hlp.geometry import quaternions, rigid, rotation_matrices
from hlp.records import Hypotheses, Votes
from hlp.settings import Count, Doc, Named, NotNegative, Positive, Registry, Settings, WholeNumber
from hlp.threads import ThreadTeam
from hlp.voting.mean_shift import find_modes

Sample = tuple[Points, Float[np.ndarray, "n 4"], Values]
"""Centroids (m), quaternions and weights of votes."""
Modes = tuple[Float[np.ndarray, "m 7"], Values]
"""Centroids (m) with quaternions, and the weight of the votes that agree with each."""


class ModeFinder(Protocol):
    """Finds coarse poses among votes."""

    def find(self, votes: Votes, centroid_obj: Point) -> Hypotheses:
        """Hypotheses, best first; none if there are no votes. `centroid_obj` is in metres."""


class VotingSettings(Named, Protocol):
    """Settings of how votes are cast and how their modes are found."""

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


ByDistance = Annotated[
    bool, Doc("votes are weighted by exp(−d²/2σ²), σ the feature scale (D; P: false)")
]
ByRegion = Annotated[
    bool, Doc("and by the largest p(object) of the windows near the patch (D; P: false)")
]
MostVotes = Annotated[Count, Doc("largest number of votes used, of largest weight (D)")]
Shifts = Annotated[WholeNumber, Le(1000), Doc("mean shift steps from each seed (D)")]


@dataclass(frozen=True)
class MeanShiftSettings(Settings):
    """What the alternatives have in common, with the paper's values. Kernels are flat."""

    name: str = ""
    max_distance: Annotated[
        NotNegative, Doc("T_h (P), in units of the codebook's feature scale; the value is ours (D)")
    ] = 3.0
    weighted_by_distance: ByDistance = False
    weighted_by_region: ByRegion = False
    translation_mm: Annotated[Positive, Doc("kernel radius for centroids (P: 10)")] = 10.0
    rotation_deg: Annotated[Positive, Doc("kernel radius for rotations (P: 5)")] = 5.0
    max_votes: MostVotes = 3000
    mean_shift_iterations: Shifts = 10

    @property
    def radius(self) -> float:
        """Kernel radius for centroids (m)."""
        return self.translation_mm / 1000.0

    @property
    def cosine(self) -> float:
        """Of half the kernel radius for rotations: the least |dot product| of quaternions."""
        return float(np.cos(np.deg2rad(self.rotation_deg) / 2.0))

    def modes(self, votes: Sample, team: ThreadTeam) -> Modes:
        """The modes of some votes, best first. The team does not affect results."""
        raise NotImplementedError

    def build(self, threads: int) -> "MeanShiftModes":
        """The mode finder. The number of `threads` does not affect results."""
        return MeanShiftModes(self, threads)


@VOTINGS.register
@dataclass(frozen=True)
class PaperVotingSettings(MeanShiftSettings):
    """Config group `voting`: independent mean shifts (paper, section 3.2).

    That of rotations is in quaternion space.
    """

    name: Literal["paper"] = "paper"

    def modes(self, votes: Sample, team: ThreadTeam) -> Modes:
        """One: the mode of translations and that of rotations with most votes."""
        centroids, quats, weights = votes
        squares = (centroids**2).sum(axis=1)
        squared = squares[:, None] + squares - 2.0 * centroids @ centroids.T
        support = (squared <= self.radius**2) @ weights
        center = centroids[[int(np.argmax(support))]]
        rotation = quats[[int(np.argmax((np.abs(quats @ quats.T) >= self.cosine) @ weights))]]
        for _ in range(self.mean_shift_iterations):
            inside = np.linalg.norm(center[:, None] - centroids, axis=-1) <= self.radius
            shares = inside * weights
            center = shares @ centroids / np.maximum(shares.sum(axis=1), 1e-12)[:, None]
            dots = rotation @ quats.T
            signs = np.where(dots < 0.0, -1.0, 1.0)  # of q and −q, the nearer one counts
            total = ((np.abs(dots) >= self.cosine) * weights * signs) @ quats
            rotation = total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None]
        return np.hstack([center, rotation]), np.array([float(support.max())])


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

    def modes(self, votes: Sample, team: ThreadTeam) -> Modes:
        """Up to `hypotheses`, those with most votes that agree in both, most first."""
        centroids, quats, weights = votes
        limits = self.mean_shift_iterations, self.hypotheses, team
        places, _ = find_modes(*votes, self.radius**2, 0.0, *limits)
        found, supports = [], []
        for place in places:
            distances = np.linalg.norm(centroids - place[:3], axis=1)
            near = distances <= max(self.radius, float(distances.min()))
            agreeing = centroids[near], quats[near], weights[near]
            turns, support = find_modes(*agreeing, np.inf, self.cosine, *limits)
            turns[:, :3] = place[:3]
            found.append(turns)
            supports.append(support)
        means, support = np.concatenate(found), np.concatenate(supports)
        order = np.argsort(-support, kind="stable")[: self.hypotheses]
        return means[order], support[order]


@VOTINGS.register
@dataclass(frozen=True)
class JointVotingSettings(MeanShiftSettings):
    """Config group `voting`: modes of the joint 6D vote (D).

    A mode gathers votes that agree in translation and in rotation; no two modes lie within the
    kernel of each other.
    """

    name: Literal["joint"] = "joint"
    weighted_by_distance: ByDistance = True
    weighted_by_region: ByRegion = True
    translation_mm: Annotated[Positive, Doc("kernel radius for centroids (D; P: 10)")] = 20.0
    rotation_deg: Annotated[Positive, Doc("kernel radius for rotations (D; P: 5)")] = 18.0
    max_votes: MostVotes = 1500
    mean_shift_iterations: Shifts = 3
    hypotheses: Annotated[
        Count, Doc("largest number of coarse poses; refinement takes the best fits (D; P: 1)")
    ] = 60

    def modes(self, votes: Sample, team: ThreadTeam) -> Modes:
        """Up to `hypotheses`, started from votes of high support."""
        limits = self.mean_shift_iterations, self.hypotheses, team
        return find_modes(*votes, self.radius**2, self.cosine, *limits)


class MeanShiftModes:
    """Coarse poses at the modes of the heaviest votes, as the settings find them."""

    def __init__(self, settings: MeanShiftSettings, threads: int = 1) -> None:
        self.settings = settings
        self._team = ThreadTeam(threads)

    def find(self, votes: Votes, centroid_obj: Point) -> Hypotheses:
        """Hypotheses that place the object's centroid at the modes; none without votes."""
        if len(votes) == 0:
            return Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))
        rows = np.argsort(-votes.weights, kind="stable")[: self.settings.max_votes]
        quats = quaternions(votes.rotations_cam_obj[rows])
        heaviest = votes.centroids_cam[rows], quats, votes.weights[rows]
        means, support = self.settings.modes(heaviest, self._team)
        rotations = rotation_matrices(means[:, 3:])
        return Hypotheses(rigid(rotations, means[:, :3] - rotations @ centroid_obj), support)
