"""Modes of the votes one after the other: first of translations, then of the rotations there."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from jaxtyping import Float

from hlp.records import Hypotheses, Votes
from hlp.settings import Doc, Settings
from hlp.thread_team import ThreadTeam
from hlp.voting.modes import (
    MAX_DISTANCE,
    MAX_VOTES,
    VOTINGS,
    centred_poses,
    find_modes,
    heaviest_votes,
    no_hypotheses,
)


@VOTINGS.register
@dataclass(frozen=True)
class SequentialVotingSettings(Settings):
    """Config group `voting`: a mean shift of translations, then one of rotations (D).

    Rotations are those of the votes that agree with the translation found, so that both belong to
    the same pose. Kernels are flat. The paper's text names two mean shifts and does not say whether
    the second is among all votes.
    """

    name: Literal["sequential"] = "sequential"
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
        int, Ge(0), Le(1000), Doc("mean shift steps from each seed (D)")
    ] = 10
    hypotheses: Annotated[
        int,
        Ge(1),
        Doc("largest number of translations, of rotations at each, and of coarse poses (P: 1)"),
    ] = 1

    def build(self, threads: int) -> "SequentialModes":
        """The mode finder. The number of `threads` does not affect results."""
        return SequentialModes(self, threads)


class SequentialModes:
    """Modes of the centroids; for each, modes of the rotations of the votes that agree with it."""

    def __init__(self, settings: SequentialVotingSettings, threads: int = 1) -> None:
        self.settings = settings
        self.radius = settings.translation_mm / 1000.0
        self.cosine = float(np.cos(np.deg2rad(settings.rotation_deg) / 2.0))
        self._team = ThreadTeam(threads)

    def find(self, votes: Votes, centroid_obj: Float[np.ndarray, "3"]) -> Hypotheses:
        """Up to `hypotheses` poses, those with most votes that agree in both, most first."""
        if len(votes) == 0:
            return no_hypotheses()
        settings = self.settings
        centroids, quats, weights = heaviest_votes(votes, settings.max_votes)
        steps = settings.mean_shift_iterations
        places, _ = find_modes(
            centroids,
            quats,
            weights,
            self.radius**2,
            0.0,
            steps,
            settings.hypotheses,
            self._team,
        )
        found = []
        for place in places:
            distances = np.linalg.norm(centroids - place[:3], axis=1)
            near = distances <= max(self.radius, float(distances.min()))
            turns, support = find_modes(
                centroids[near],
                quats[near],
                weights[near],
                np.inf,
                self.cosine,
                steps,
                settings.hypotheses,
                self._team,
            )
            turns[:, :3] = place[:3]
            found.append((turns, support))
        means = np.concatenate([turns for turns, _ in found])
        support = np.concatenate([each for _, each in found])
        order = np.argsort(-support, kind="stable")[: settings.hypotheses]
        poses = centred_poses(means[order, :3], means[order, 3:], centroid_obj)
        return Hypotheses(poses, support[order])
