"""Fine pose by particle swarm optimisation (paper, Section 3.3; Kennedy & Eberhart 1995)."""

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.cost import CostSettings, DepthCost
from hlp.refinement.refiner import Refiner, checked_poses
from hlp.refinement.swarm_kernel import moved, update_personal_bests, update_swarm
from hlp.refinement.verification import VerificationSettings
from hlp.thread_team import ThreadTeam

_POLISH = 1 << 16  # the polish's random stream; those of hypotheses are numbered from 0


@dataclass(frozen=True)
class PolishSettings:
    """The second search, about the answer; see conf/refinement/pso.yaml for what each means."""

    theta_deg: float
    tau_mm: float
    patience: int


@dataclass(frozen=True)
class PsoSettings:
    """Settings of the swarm and its cost; see conf/refinement/pso.yaml for what each means."""

    name: str
    cost: CostSettings
    verification: VerificationSettings
    particles: int
    theta_deg: float
    tau_mm: float
    phi_1: float
    phi_2: float
    iterations: int
    patience: int
    recentre: bool
    polish: PolishSettings | None
    budget_ms: float
    threads: int

    def __post_init__(self) -> None:
        """Raise ValueError where the swarm would have no constriction."""
        if not self.phi_1 + self.phi_2 > 4.0:
            raise ValueError(
                f"refinement.phi_1 + phi_2 is {self.phi_1 + self.phi_2}: it must be above 4"
            )


class PsoRefiner(Refiner):
    """Canonical PSO over six degrees of freedom around the coarse pose."""

    def __init__(self, settings: PsoSettings) -> None:
        self._settings = settings
        self._team = ThreadTeam(settings.threads)

    def refine(
        self,
        model: ObjectModel,
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
    ) -> list[Refinement]:
        """See Refiner.refine. Each hypothesis has its personal_best random stream.

        With a budget (`budget_ms` > 0) the time left is shared evenly among the hypotheses left,
        of which as many run at once as there are threads; those that are left when it is over stay
        as they are. What time allows differs from run to run, so poses are then not reproducible.
        """
        poses = checked_poses(hypotheses, model)
        settings = self._settings
        # Whole hypotheses are shared out: an iteration is too short to be.
        at_once = min(settings.threads, len(poses))
        end = time.perf_counter() + self._left(spent)

        def one(index: int) -> Refinement:
            now = time.perf_counter()
            if now > end:
                return Refinement(poses[index], 0)
            deadline = now + (end - now) * min(at_once / (len(poses) - index), 1.0)
            rng = np.random.default_rng([seed, index])
            cost = DepthCost(model.proxy, depth, camera_matrix, poses[index], settings.cost)
            best, iterations = search(cost, poses[index], model.centroid, settings, rng, deadline)
            return Refinement(best, iterations)

        return self._team.map(one, len(poses))

    def polish(
        self,
        model: ObjectModel,
        depth: Float[np.ndarray, "h w"],
        camera_matrix: Float[np.ndarray, "3 3"],
        answer: Refinement,
        seed: int,
        spent: float = 0.0,
    ) -> Refinement:
        """See Refiner.polish: a search of a smaller box, in the time left."""
        polish, left = self._settings.polish, self._left(spent)
        if polish is None or left <= 0.0:
            return answer
        settings = replace(
            self._settings,
            theta_deg=polish.theta_deg,
            tau_mm=polish.tau_mm,
            patience=polish.patience,
        )
        pose = answer.pose_cam_obj
        cost = DepthCost(model.proxy, depth, camera_matrix, pose, settings.cost)
        rng = np.random.default_rng([seed, _POLISH])
        deadline = time.perf_counter() + left
        best, iterations = search(cost, pose, model.centroid, settings, rng, deadline)
        return Refinement(best, answer.iterations + iterations)

    def _left(self, spent: float) -> float:
        """Seconds left of the budget; infinite without one."""
        budget = self._settings.budget_ms
        return budget / 1000.0 - spent if budget > 0 else np.inf


def search(
    cost: DepthCost,
    pose_cam_obj: Float[np.ndarray, "4 4"],
    centroid: Float[np.ndarray, "3"],
    settings: PsoSettings,
    rng: np.random.Generator,
    deadline: float = np.inf,
) -> tuple[Float[np.ndarray, "4 4"], int]:
    """Pose of least cost found around a pose, and the number of iterations it took.

    Positions are fractions of the box (θ, τ) around the box's centre. With `recentre` the box
    follows the best pose, so that poses outside it can be reached in several steps; particles keep
    their place relative to the box, which is exact for the best pose and, as rotations about
    different centres do not quite add, approximate for the others' memories. `deadline` is a
    reading of time.perf_counter() after which no iteration begins.
    """
    box = np.repeat([np.deg2rad(settings.theta_deg), settings.tau_mm / 1000.0], 3)
    phi = settings.phi_1, settings.phi_2
    constriction = 2.0 / abs(2.0 - sum(phi) - np.sqrt(sum(phi) ** 2 - 4.0 * sum(phi)))
    centre = np.array(pose_cam_obj, dtype=np.float64)
    position = rng.uniform(-1.0, 1.0, (settings.particles, 6))
    position[0] = 0.0
    velocity = rng.uniform(-1.0, 1.0, position.shape)
    personal_best, personal_best_cost = (
        position.copy(),
        cost.evaluate(moved(centre, position * box, centroid)),
    )
    best = int(personal_best_cost.argmin())
    lowest, global_best, idle, iteration = (
        personal_best_cost[best],
        personal_best[best].copy(),
        0,
        0,
    )
    while iteration < settings.iterations and idle < settings.patience:
        if time.perf_counter() > deadline:
            break
        iteration += 1
        if settings.recentre and global_best.any():
            centre = moved(centre, global_best[None] * box, centroid)[0]
            position, personal_best, global_best = (
                position - global_best,
                personal_best - global_best,
                np.zeros(6),
            )
        update_swarm(
            position,
            velocity,
            personal_best,
            global_best,
            rng.random((2, *position.shape)),
            phi,
            constriction,
        )
        current = cost.evaluate(moved(centre, position * box, centroid))
        best = update_personal_bests(position, current, personal_best, personal_best_cost)
        idle = 0 if personal_best_cost[best] < lowest else idle + 1
        lowest, global_best = personal_best_cost[best], personal_best[best].copy()
    return moved(centre, global_best[None] * box, centroid)[0], iteration
