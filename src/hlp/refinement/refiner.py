"""Interface of the refiners, which coarse poses they accept, and what may be turned over."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from hlp.arrays import Flags, Point, Pose, Poses
from hlp.records import Hypotheses, ObjectModel
from hlp.refinement.cost import CostSettings, DepthCost
from hlp.refinement.verification import Observation, VerificationSettings, Verifier
from hlp.settings import Named, Registry, Settings

_CLEARLY = 0.8  # of a pose's cost: half a turn away from a right one, none costs less (D)


@dataclass(frozen=True)
class Refinement:
    """A refined pose and the number of iterations it took; whether it was given up as hopeless."""

    pose_cam_obj: Pose
    iterations: int
    given_up: bool = False


IsHopeless = Callable[[Pose], bool]
"""Whether a pose will not become right by being refined."""


class Refiner(Protocol):
    """Stage 3: moves coarse poses until the rendered model fits the observed depth (paper, 3.3)."""

    def refine(
        self,
        model: ObjectModel,
        observation: Observation,
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
        is_hopeless: IsHopeless | None = None,
    ) -> list[Refinement]:
        """One refinement per hypothesis, in the same order; all are `refinable`.

        `spent` (s) is the part of the refiner's time budget that is already used. Without a budget,
        equal inputs and seeds give equal poses. A hypothesis whose pose `is_hopeless` after some
        iterations may be given up: it is left as it then is.
        """

    def soon(self) -> "Refiner":
        """The refiner for a first look, in less time; by default the same."""
        return self

    def second_search(
        self, model: ObjectModel, observation: Observation, chosen: Refinement, spent: float = 0.0
    ) -> Refinement:
        """A more exact pose for the hypothesis that was chosen; by default the same pose."""
        return chosen

    def follow(
        self, model: ObjectModel, observation: Observation, pose_cam_obj: Pose, seed: int
    ) -> Refinement:
        """The pose in a frame that comes soon after the one of `pose_cam_obj`, in little time.

        By default it is refined as a hypothesis is.
        """
        start = Hypotheses(pose_cam_obj[None], np.ones(1))
        return self.refine(model, observation, start, seed)[0]


class RefinementSettings(Named, Protocol):
    """Settings of a refiner."""

    @property
    def verification(self) -> VerificationSettings:
        """The cost that ranks coarse poses and chooses among the refined ones."""

    def build(self, threads: int) -> Refiner:
        """The refiner. The number of `threads` does not affect results."""


REFINERS: Registry[RefinementSettings] = Registry("refinement", "hlp.refinement")
"""Alternatives of config group `refinement`."""


def cost_around(
    model: ObjectModel, observation: Observation, pose_cam_obj: Pose, settings: CostSettings
) -> DepthCost:
    """Cost of the poses near a coarse one (Eq. 2)."""
    return DepthCost(
        model.proxy,
        observation.depth,
        observation.camera_matrix,
        pose_cam_obj,
        settings,
        observation.edges_of(model),
    )


def refinable(poses_cam_obj: Poses, centroid: Point) -> Flags:
    """Which poses are finite and put the centroid (object coordinates, m) in front of the camera.

    Where the origin lies does not matter: a CAD file may have it far outside the object.
    """
    depths = poses_cam_obj[:, 2, :3] @ centroid + poses_cam_obj[:, 2, 3]
    return np.asarray(np.isfinite(poses_cam_obj).all(axis=(1, 2)) & (depths > 0.0))


def turned_over(
    refiner: Refiner, verifier: Verifier, observation: Observation, pose_cam_obj: Pose, seed: int
) -> Refinement | None:
    """The best of the poses half a turn away, refined; None if it does not cost clearly less.

    Upside down or end for end, a flat part fits nearly as well (`Verifier.half_turns`), and the
    swarm does not turn so far.
    """
    poses = pose_cam_obj @ verifier.half_turns
    if len(poses) == 0:
        return None
    turned = Hypotheses(poses, np.ones(len(poses)))
    found = refiner.refine(verifier.model, observation, turned, seed)
    refined = [each.pose_cam_obj for each in found]
    before, *costs = verifier.costs(observation, np.stack([pose_cam_obj, *refined]))
    if min(costs) >= before:  # a second search lowers a cost by little
        return None
    best = refiner.second_search(verifier.model, observation, found[int(np.argmin(costs))])
    after = verifier.costs(observation, best.pose_cam_obj[None])[0]
    return best if after < _CLEARLY * before else None


@REFINERS.register
@dataclass(frozen=True)
class NoneSettings(Settings):
    """Config group `refinement`: coarse poses as they are, ranked as after refinement."""

    name: Literal["none"] = "none"
    verification: VerificationSettings = field(default_factory=VerificationSettings)

    def build(self, threads: int) -> "NoneRefiner":
        """The refiner; it has nothing to do."""
        return NoneRefiner()


class NoneRefiner(Refiner):
    """Leaves every pose where it is."""

    def refine(
        self,
        model: ObjectModel,
        observation: Observation,
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
        is_hopeless: IsHopeless | None = None,
    ) -> list[Refinement]:
        """See `Refiner.refine`. Only the hypotheses are used: nothing is random or timed."""
        return [Refinement(pose, 0) for pose in hypotheses.poses_cam_obj]
