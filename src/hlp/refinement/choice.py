"""Stage 3 of one object: which hypotheses are refined, and which refined one is the answer."""

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.refiner import Refiner, checked_poses
from hlp.refinement.verification import Observation, Verifier

_TOGETHER = 2  # hypotheses that are refined before it is asked whether others are worth it


@dataclass(frozen=True)
class RefinedHypotheses:
    """What stage 3 makes of the hypotheses: those refined, which they were, and the answer's index.

    `refined[i]` comes of the coarse hypothesis `sources[i]` and has the verification cost
    `costs[i]`; `refined[best]` is the answer.
    """

    refined: list[Refinement]
    costs: Float[np.ndarray, "c"]
    sources: Int[np.ndarray, "c"]
    best: int


def refine_and_choose(
    refiner: Refiner,
    verifier: Verifier,
    observation: Observation,
    model: ObjectModel,
    hypotheses: Hypotheses,
    candidates: int,
    max_improvement: float,
    seed: int,
) -> RefinedHypotheses:
    """Refine the hypotheses worth it, choose one by its verification cost, polish it.

    At least one hypothesis is needed. Those of least verification cost come first, two at a time
    and at most `candidates`, until the next is behind the best refined one by more than
    `max_improvement`: refining hardly ever gains as much. Raises what `Refiner.refine` raises.
    """
    begun = time.perf_counter()
    depth, camera = observation.depth, observation.camera_matrix
    poses = checked_poses(hypotheses)
    screened = verifier.costs(observation, poses)
    order = np.argsort(screened, kind="stable")[:candidates]
    refined: list[Refinement] = []
    lowest = np.inf
    for start in range(0, len(order), _TOGETHER):
        part = order[start : start + _TOGETHER]
        if screened[part[0]] - max_improvement > lowest:
            break
        some = Hypotheses(poses[part], hypotheses.support[part])
        spent = time.perf_counter() - begun
        own = seed + start  # the refiner numbers hypotheses from 0 again
        refined += refiner.refine(model, depth, camera, some, own, spent)
        lowest = min(lowest, verifier.costs(observation, _poses(refined[start:])).min())
    sources = order[: len(refined)]
    costs = verifier.competing_costs(observation, _poses(refined), hypotheses.support[sources])
    best = int(np.argmin(costs))
    spent = time.perf_counter() - begun
    refined[best] = refiner.polish(model, depth, camera, refined[best], seed, spent)
    return RefinedHypotheses(refined, costs, sources, best)


def _poses(refined: list[Refinement]) -> Float[np.ndarray, "c 4 4"]:
    return np.stack([each.pose_cam_obj for each in refined])
