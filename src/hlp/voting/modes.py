"""From matched codebook entries to votes for a pose, and the modes of these votes.

The paper finds modes by independent mean shifts; here also one after another, or jointly in 6D.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float

from hlp.arrays import Point, Points, Values
from hlp.geometry import allocentric_to_egocentric, quaternions, rigid, rotation_matrices
from hlp.kernels import ThreadTeam
from hlp.records import Codebook, Hypotheses, LocalPatches, Matches, ObjectModel, Votes
from hlp.settings import Count, Doc, NotNegative, Positive, Registry, Settings
from hlp.voting.mean_shift import find_modes

# An upright object seen from 45° above: for objects that stand upright, no small change of the pose
# changes which of the equivalent rotations is nearest to this one.
_REFERENCE_ROTATION = np.array(
    [[1.0, 0.0, 0.0], [0.0, -np.sqrt(0.5), -np.sqrt(0.5)], [0.0, np.sqrt(0.5), -np.sqrt(0.5)]]
)


def cast_votes(
    patches: LocalPatches,
    matches: Matches,
    codebook: Codebook,
    model: ObjectModel,
    max_distance: float,
    weighted_by_distance: bool,
    patch_weights: Values | None = None,
) -> Votes:
    """One vote per accepted neighbour: rotation R, centroid p_cam + R·(centroid − p_obj).

    R is the rotation of the codebook entry, converted from allocentric to egocentric for the
    patch's viewing ray (paper, section 3.2). Neighbours farther than `max_distance` (the paper's
    Th, in units of the codebook's `feature_scale`) cast no vote. With `weighted_by_distance` a vote
    weighs exp(−d²/2), d in the same units, otherwise 1; `patch_weights` multiplies the votes of
    each of the n patches. Of the equivalent rotations of a symmetric object all votes take the same
    one, see `canonical_rotations`.
    """
    relative = matches.distances / codebook.feature_scale
    rows, ranks = np.nonzero(relative <= max_distance)
    entries = matches.indices[rows, ranks]
    points_cam = patches.points_cam[rows]
    to_egocentric = allocentric_to_egocentric(patches.points_cam)[rows]
    rotations = to_egocentric @ codebook.rotations_cam_obj[entries].astype(np.float64)
    to_centroid = model.centroid - codebook.points_obj[entries]
    centroids = points_cam + np.einsum("vij,vj->vi", rotations, to_centroid)
    weights = (
        np.exp(-(relative[rows, ranks] ** 2) / 2.0) if weighted_by_distance else np.ones(len(rows))
    )
    if patch_weights is not None:
        weights = weights * patch_weights[rows]
    canonical = canonical_rotations(rotations, model.symmetries)
    return Votes(centroids, canonical, weights.astype(np.float64), rows, patches.pixels[rows])


def canonical_rotations(
    rotations: Float[np.ndarray, "v 3 3"], symmetries: Float[np.ndarray, "s 4 4"]
) -> Float[np.ndarray, "v 3 3"]:
    """Of each rotation's equivalents R·S under the symmetries S, the nearest to a fixed reference.

    Without this, the votes for one pose of a bowl would spread around its axis and form no mode.
    """
    if len(symmetries) == 1:
        return rotations
    equivalent = symmetries[:, :3, :3]
    # tr(Aᵀ R S) is largest where R S is nearest to A. One matrix product gives all traces.
    relative = np.swapaxes(rotations, 1, 2) @ _REFERENCE_ROTATION
    traces = relative.reshape(-1, 9) @ equivalent.reshape(-1, 9).T
    return np.asarray(rotations @ equivalent[np.argmax(traces, axis=1)])


Quaternions = Float[np.ndarray, "n 4"]
Modes = tuple[Float[np.ndarray, "m 7"], Values]
"""Centroids (m) with quaternions, and the weight of the votes that agree with each."""


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

    def modes(
        self, centroids: Points, quats: Quaternions, weights: Values, team: ThreadTeam
    ) -> Modes:
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

    def modes(
        self, centroids: Points, quats: Quaternions, weights: Values, team: ThreadTeam
    ) -> Modes:
        """One: the mode of translations and that of rotations with most votes."""
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

    def modes(
        self, centroids: Points, quats: Quaternions, weights: Values, team: ThreadTeam
    ) -> Modes:
        """Up to `hypotheses`, those with most votes that agree in both, most first."""
        limits = self.mean_shift_iterations, self.hypotheses, team
        places, _ = find_modes(centroids, quats, weights, self.radius**2, 0.0, *limits)
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

    def modes(
        self, centroids: Points, quats: Quaternions, weights: Values, team: ThreadTeam
    ) -> Modes:
        """Up to `hypotheses`, started from votes of high support."""
        limits = self.mean_shift_iterations, self.hypotheses, team
        return find_modes(centroids, quats, weights, self.radius**2, self.cosine, *limits)


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
        means, support = self.settings.modes(
            votes.centroids_cam[rows], quats, votes.weights[rows], self._team
        )
        rotations = rotation_matrices(means[:, 3:])
        return Hypotheses(rigid(rotations, means[:, :3] - rotations @ centroid_obj), support)
