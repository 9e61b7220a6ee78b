"""Stage 3 of one object: choose the hypotheses to refine, and the best refined one."""

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.refiner import Refiner, refinable
from hlp.refinement.texture import choose_sibling
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

    Before it is polished, the chosen pose gives way to that of its siblings whose colours agree
    best with the image.

    Hypotheses that are not finite or lie behind the camera are dropped; None if no other is left.
    The rest is refined in order of verification cost, two at a time and at most `candidates`, until
    the next one costs more than the best refined pose by `max_improvement`: refinement hardly ever
    lowers a cost by that much. The polished pose is kept unless its cost, among the refined poses,
    is higher than before.
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
    support = hypotheses.support[sources]
    costs = verifier.competing_costs(observation, _poses(refined), support)
    best = int(np.argmin(costs))
    if len(model.siblings) > 0:
        told = choose_sibling(observation, model, refined[best].pose_cam_obj)
        refined[best] = replace(refined[best], pose_cam_obj=told.pose_cam_obj)
        costs = verifier.competing_costs(observation, _poses(refined), support)
    spent = time.perf_counter() - begun
    polished = refiner.polish(model, depth, camera, refined[best], seed, spent)
    chosen = RefinedHypotheses(refined, costs, sources, best)
    return _with_polished(chosen, polished, verifier, observation, support)


def _with_polished(
    chosen: RefinedHypotheses,
    polished: Refinement,
    verifier: Verifier,
    observation: Observation,
    support: Float[np.ndarray, "c"],
) -> RefinedHypotheses:
    """The polished pose and its cost in place of the best, unless it costs more among the others.

    The refiner's cost is not the verifier's, so a polished pose may fit the image less well.
    """
    best, refined, costs = chosen.best, list(chosen.refined), chosen.costs.copy()
    refined[best] = polished
    costs[best] = verifier.competing_costs(observation, _poses(refined), support)[best]
    if costs[best] > chosen.costs[best]:
        return chosen
    return replace(chosen, refined=refined, costs=costs)


def _poses(refined: list[Refinement]) -> Float[np.ndarray, "c 4 4"]:
    return np.stack([each.pose_cam_obj for each in refined])
