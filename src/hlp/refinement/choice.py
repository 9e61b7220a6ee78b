"""Stage 3 of one object: choose the hypotheses to refine, and the best refined one."""

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.refiner import Refiner, refinable
from hlp.refinement.verification import Observation, Verifier

_BATCH = 2  # hypotheses refined before the next ones are compared with the best so far


@dataclass(frozen=True)
class RefinedHypotheses:
    """The refined hypotheses of one object, and which of them was chosen.

    `refined[i]` was refined from the coarse hypothesis of index `sources[i]` and has the
    verification cost `costs[i]`; `refined[best]` is the result.
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
) -> RefinedHypotheses | None:
    """Refine the most promising hypotheses, choose the one of lowest verification cost, polish it.

    Hypotheses that are not finite or lie behind the camera are dropped; None if no other is left.
    The rest is refined in order of verification cost, two at a time and at most `candidates`, until
    the next one costs more than the best refined pose by `max_improvement`: refinement hardly ever
    lowers a cost by that much.
    """
    begun = time.perf_counter()
    depth, camera = observation.depth, observation.camera_matrix
    poses = np.asarray(hypotheses.poses_cam_obj, dtype=np.float64)
    usable = np.flatnonzero(refinable(poses, model.centroid))
    if len(usable) == 0:
        return None
    coarse_costs = verifier.costs(observation, poses[usable])
    ranking = np.argsort(coarse_costs, kind="stable")[:candidates]
    order, coarse_costs = usable[ranking], coarse_costs[ranking]
    refined: list[Refinement] = []
    lowest = np.inf
    for start in range(0, len(order), _BATCH):
        if coarse_costs[start] - max_improvement > lowest:
            break
        rows = order[start : start + _BATCH]
        batch = Hypotheses(poses[rows], hypotheses.support[rows])
        spent = time.perf_counter() - begun
        batch_seed = seed + start  # the refiner numbers each batch's hypotheses from 0
        refined += refiner.refine(model, depth, camera, batch, batch_seed, spent)
        lowest = min(lowest, verifier.costs(observation, _poses(refined[start:])).min())
    sources = order[: len(refined)]
    costs = verifier.competing_costs(observation, _poses(refined), hypotheses.support[sources])
    best = int(np.argmin(costs))
    spent = time.perf_counter() - begun
    refined[best] = refiner.polish(model, depth, camera, refined[best], seed, spent)
    return RefinedHypotheses(refined, costs, sources, best)


def _poses(refined: list[Refinement]) -> Float[np.ndarray, "c 4 4"]:
    return np.stack([each.pose_cam_obj for each in refined])
