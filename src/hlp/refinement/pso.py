"""Fine pose by particle swarm optimisation (paper, section 3.3; Kennedy & Eberhart 1995)."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Le
from jaxtyping import Float

from hlp.arrays import Point, Pose
from hlp.records import Hypotheses, ObjectModel
from hlp.refinement.cost import CostSettings, DepthCost
from hlp.refinement.refiner import REFINERS, IsHopeless, Refinement, Refiner, cost_around
from hlp.refinement.swarm_kernel import apply_offsets, update_personal_bests, update_swarm
from hlp.refinement.verification import Observation, VerificationSettings
from hlp.settings import Count, Doc, NotNegative, Settings, SettingsError, WholeNumber
from hlp.threads import ThreadTeam, threads_here

_FOLLOW_STREAM = 1 << 17  # random stream; hypotheses use 0, 1, …
_FLAT = 1e-9  # bend of a parabola: with less it has no lowest point
_EARLY = 3  # steps by parabolas after which a hopeless pose is given up (D)
_HOPELESS = 0.3  # of the highest cost: what costs more then, of an object without colours (D)


Offset = Float[np.ndarray, "6"]
"""Three angles (rad) and three distances (m), see `apply_offsets`."""


@dataclass(frozen=True)
class DescentSettings(Settings):
    """A search by parabolas (`descend`) (D)."""

    theta_deg: Annotated[NotNegative, Doc("largest step in rotation (D)")] = 5.0
    tau_mm: Annotated[NotNegative, Doc("largest step in translation (D)")] = 5.0
    patience: Annotated[
        WholeNumber, Doc("iterations with little gain before stopping; each halves the steps (D)")
    ] = 5
    iterations: Annotated[Count, Le(10_000), Doc("largest number of iterations (D)")] = 12


@dataclass(frozen=True)
class FollowSettings(Settings):
    """The search about the last pose of an object that is tracked (D).

    Chosen on rendered sequences: 25 particles are right as often, up to 20 mm and 10° a frame.
    """

    theta_deg: Annotated[NotNegative, Doc("half the side of the box in rotation (D)")] = 3.0
    tau_mm: Annotated[NotNegative, Doc("half the side of the box in translation (D)")] = 3.0
    patience: Annotated[WholeNumber, Doc("iterations without gain before stopping (D)")] = 6
    particles: Annotated[Count, Le(10_000), Doc("number of particles (D)")] = 15


@REFINERS.register
@dataclass(frozen=True)
class PsoSettings(Settings):
    """Config group `refinement`: particle swarm optimisation (paper, section 3.3)."""

    name: Literal["pso"] = "pso"
    cost: CostSettings = field(default_factory=CostSettings)
    verification: VerificationSettings = field(default_factory=VerificationSettings)
    particles: Annotated[Count, Le(10_000), Doc("number of particles (P: N = 25)")] = 25
    theta_deg: Annotated[NotNegative, Doc("θ, half the box in rotation (D; P: 5)")] = 10.0
    tau_mm: Annotated[NotNegative, Doc("τ, half the box in translation (D; P: 5)")] = 10.0
    phi_1: Annotated[
        NotNegative, Doc("pull to the personal best (D: Clerc & Kennedy; constriction 0.7298)")
    ] = 2.8
    phi_2: Annotated[
        NotNegative, Doc("pull to the global best; phi_1 + phi_2 must be above 4 (D)")
    ] = 1.3
    iterations: Annotated[WholeNumber, Le(10_000), Doc("largest number of iterations (D)")] = 14
    patience: Annotated[WholeNumber, Doc("iterations without gain before stopping (D; P: 1)")] = 6
    recentre: Annotated[
        bool, Doc("the box follows the best pose, up to 30° away (D; P: not said, false)")
    ] = True
    descent: Annotated[
        DescentSettings | None,
        Doc("steps by parabolas before a hypothesis has its swarm (D); null: none (P)"),
    ] = field(default_factory=lambda: DescentSettings(10.0, 8.0, 6, 6))
    second_search: Annotated[
        DescentSettings | None,
        Doc("a second, narrower search around the chosen pose, by parabolas (D); null: none (P)"),
    ] = field(default_factory=DescentSettings)
    budget_ms: Annotated[
        float | None,
        Gt(0),
        Doc("limit of stage 3's wall time for an object; null: none. Not reproducible (D)"),
    ] = None
    gain: Annotated[
        Literal["swarm", "particle"],
        Doc(
            "which improvement lets the swarm go on: of its best pose (D), or of any particle's "
            "best (the text: until no particle improves)"
        ),
    ] = "swarm"
    follow: FollowSettings = field(default_factory=FollowSettings)

    def __post_init__(self) -> None:
        """Raise SettingsError where the swarm would have no constriction."""
        super().__post_init__()
        total = self.phi_1 + self.phi_2
        if not total > 4.0:
            raise SettingsError("phi_1 + phi_2", f"is {total}: it must be above 4")

    def build(self, threads: int) -> "PsoRefiner":
        """The refiner; each thread refines whole hypotheses. Threads do not affect results."""
        return PsoRefiner(self, threads)


class PsoRefiner(Refiner):
    """Canonical PSO over six degrees of freedom around the coarse pose."""

    def __init__(self, settings: PsoSettings, threads: int = 1) -> None:
        self._settings, self._team = settings, ThreadTeam(threads)

    def refine(
        self,
        model: ObjectModel,
        observation: Observation,
        hypotheses: Hypotheses,
        seed: int,
        spent: float = 0.0,
        is_hopeless: IsHopeless | None = None,
    ) -> list[Refinement]:
        """See `Refiner.refine`. Each hypothesis has its own random stream.

        With a time budget (`budget_ms`) the remaining time is divided evenly among the remaining
        hypotheses; those not begun when it is used up stay as they are.
        """
        poses = hypotheses.poses_cam_obj
        at_once = min(threads_here(self._team.threads), len(poses))
        end = time.perf_counter() + self._remaining(spent)
        weights = self._settings.cost.weight_depth + self._settings.cost.weight_image_edge
        highest = np.inf if model.mesh.colored else _HOPELESS * weights

        def refine_one(index: int) -> Refinement:
            now = time.perf_counter()
            if now > end:
                return Refinement(poses[index], 0)
            deadline = now + (end - now) * min(at_once / (len(poses) - index), 1.0)
            limits = (seed, index), deadline, is_hopeless, highest
            return _search(model, observation, poses[index], self._settings, *limits)

        return self._team.map(refine_one, len(poses))

    def soon(self) -> "PsoRefiner":
        """See `Refiner.soon`: by parabolas alone, if they are set."""
        if self._settings.descent is None:
            return self
        return PsoRefiner(replace(self._settings, iterations=0), self._team.threads)

    def second_search(
        self, model: ObjectModel, observation: Observation, chosen: Refinement, spent: float = 0.0
    ) -> Refinement:
        """See `Refiner.second_search`: `descend`, if there is time left. Nothing is random."""
        second = self._settings.second_search
        if second is None or self._remaining(spent) <= 0.0:
            return chosen
        cost = cost_around(model, observation, chosen.pose_cam_obj, self._settings.cost)
        pose, iterations = descend(cost, chosen.pose_cam_obj, model.centroid, second)
        return Refinement(pose, chosen.iterations + iterations)

    def follow(
        self, model: ObjectModel, observation: Observation, pose_cam_obj: Pose, seed: int
    ) -> Refinement:
        """See `Refiner.follow`: one search with fewer particles in a smaller box."""
        settings = replace(self._settings, descent=None, **vars(self._settings.follow))
        return _search(model, observation, pose_cam_obj, settings, (seed, _FOLLOW_STREAM))

    def _remaining(self, spent: float) -> float:
        """Remaining seconds of the budget; infinite without a budget."""
        budget = self._settings.budget_ms
        return np.inf if budget is None else budget / 1000.0 - spent


def _search(
    model: ObjectModel,
    observation: Observation,
    pose_cam_obj: Pose,
    settings: PsoSettings,
    stream: tuple[int, int],
    deadline: float = np.inf,
    is_hopeless: IsHopeless | None = None,
    hopeless_cost: float = np.inf,
) -> Refinement:
    """One hypothesis: `descend`, if it is set, then `search` with a random stream of its own."""
    given_up = False

    def goes_on(done: int, lowest: float, pose: Pose) -> bool:
        nonlocal given_up
        if done == _EARLY:
            given_up = lowest > hopeless_cost or (is_hopeless is not None and is_hopeless(pose))
        return not given_up

    cost, pose, done = cost_around(model, observation, pose_cam_obj, settings.cost), pose_cam_obj, 0
    if settings.descent is not None:
        pose, done = descend(cost, pose, model.centroid, settings.descent, goes_on)
        if given_up or settings.iterations == 0:
            return Refinement(pose, done, given_up)
        cost = cost_around(model, observation, pose, settings.cost)
    rng = np.random.default_rng(stream)
    pose, iterations = search(cost, pose, model.centroid, settings, rng, deadline)
    return Refinement(pose, done + iterations)


def search(
    cost: DepthCost,
    pose_cam_obj: Pose,
    centroid: Point,
    settings: PsoSettings,
    rng: np.random.Generator,
    deadline: float = np.inf,
) -> tuple[Pose, int]:
    """The pose of lowest cost found around a pose, and the number of iterations.

    Positions are offsets from the box's centre in units of (θ, τ). With `recentre` the box follows
    the best pose, so that poses outside the first box can be reached; positions are then shifted so
    that the best is 0, which is approximate for others, since rotations do not add. No iteration
    begins after the `deadline` (`time.perf_counter`).
    """
    box = _box(settings.theta_deg, settings.tau_mm)
    phi = settings.phi_1, settings.phi_2
    constriction = 2.0 / abs(2.0 - sum(phi) - np.sqrt(sum(phi) ** 2 - 4.0 * sum(phi)))
    centre = np.array(pose_cam_obj, dtype=np.float64)
    position = rng.uniform(-1.0, 1.0, (settings.particles, 6))
    position[0] = 0.0
    velocity = rng.uniform(-1.0, 1.0, position.shape)
    personal_best = position.copy()
    personal_cost = cost.evaluate(apply_offsets(centre, position * box, centroid))
    best = int(personal_cost.argmin())
    global_best, global_cost = personal_best[best].copy(), personal_cost[best]
    idle, iteration = 0, 0
    while iteration < settings.iterations and idle < settings.patience:
        if time.perf_counter() > deadline:
            break
        iteration += 1
        if settings.recentre and global_best.any():
            centre = apply_offsets(centre, global_best[None] * box, centroid)[0]
            position, personal_best = position - global_best, personal_best - global_best
            global_best = np.zeros(6)
        random = rng.random((2, *position.shape))
        update_swarm(position, velocity, personal_best, global_best, random, phi, constriction)
        current = cost.evaluate(apply_offsets(centre, position * box, centroid))
        own_gain = settings.gain == "particle" and bool((current < personal_cost).any())
        best = update_personal_bests(position, current, personal_best, personal_cost)
        idle = 0 if own_gain or personal_cost[best] < global_cost else idle + 1
        global_best, global_cost = personal_best[best].copy(), personal_cost[best]
    return apply_offsets(centre, global_best[None] * box, centroid)[0], iteration


def descend(
    cost: DepthCost,
    pose_cam_obj: Pose,
    centroid: Point,
    settings: DescentSettings,
    goes_on: Callable[[int, float, Pose], bool] = lambda *_: True,
) -> tuple[Pose, int]:
    """A pose near one that costs no more, found by parabolas, and the number of iterations.

    The cost is taken one step back and forth along each of the six offsets. The pose then moves to
    the cheapest of these: the lowest points of the six parabolas through them, each at most a step
    away; half of that; the best single step; and half way between it and the first. Where none of
    them costs less, or shorter steps would do, steps are halved. Before each iteration `goes_on` is
    asked: given their number, the lowest cost and its pose.
    """
    steps = _box(settings.theta_deg, settings.tau_mm)
    pose, lowest = pose_cam_obj, float(cost.evaluate(pose_cam_obj[None])[0])
    single = np.concatenate([np.eye(6), -np.eye(6)])
    idle, iteration = 0, 0
    while iteration < settings.iterations and idle < settings.patience:
        if not goes_on(iteration, lowest, pose):
            break
        iteration += 1
        scale = steps / 2.0**idle
        costs = cost.evaluate(apply_offsets(pose, single * scale, centroid))
        slope, bend = (costs[:6] - costs[6:]) / 2.0, costs[:6] + costs[6:] - 2.0 * lowest
        bottom = -slope / np.maximum(bend, _FLAT)  # far away where there is none
        bottom = np.clip(bottom, -1.0, 1.0)
        best = single[costs.argmin()] * (costs.min() < lowest)
        tried = np.stack([bottom, bottom / 2.0, best, (bottom + best) / 2.0])
        poses = apply_offsets(pose, tried * scale, centroid)
        costs = cost.evaluate(poses)
        row = int(costs.argmin())
        if costs[row] >= lowest:
            idle += 1
            continue
        pose, lowest = poses[row], float(costs[row])
        idle += int(np.abs(tried[row]).max() < 0.5)
    return pose, iteration


def _box(theta_deg: float, tau_mm: float) -> Offset:
    """Half the sides of a box, of three angles (rad) and three distances (m)."""
    return np.repeat([np.deg2rad(theta_deg), tau_mm / 1000.0], 3)
