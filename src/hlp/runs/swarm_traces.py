"""The particle swarm's searches for a target once more, this time with all costs kept."""

from typing import Any

import numpy as np
from jaxtyping import Float

from hlp.records import ObjectModel, Refinement, Target
from hlp.refinement.cost import DepthCost
from hlp.refinement.pso import PsoSettings, search
from hlp.refinement.refiner import cost_around
from hlp.refinement.texture import choose_sibling
from hlp.refinement.verification import Observation, observe
from hlp.reporting.figures.swarm_costs import Swarm, SwarmsOfTarget
from hlp.runs.shown_targets import FrameResults
from hlp.stages.detection import DetectionStages

_MOST = 5  # hypotheses of a target


class RecordedCost(DepthCost):
    """A cost that keeps what it has said of every swarm, in `rounds`."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.rounds: list[Float[np.ndarray, "particles"]] = []

    def evaluate(self, poses_cam_obj: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n"]:
        """See `DepthCost.evaluate`."""
        costs = super().evaluate(poses_cam_obj)
        # A copy: the search goes on to write the particles' best costs into the first ones.
        self.rounds.append(costs.copy())
        return costs


def swarms_of_target(
    detection: DetectionStages, found: FrameResults, target: Target, verdict: str
) -> SwarmsOfTarget | None:
    """The first searches for a target's object; None where none can be repeated.

    The chosen one led to the answer that is nearest to the target. The title tells the `verdict` on
    the answer.
    """
    object_id, answer = target.object_id, found.nearest(target)
    refined, chosen = found.trace[object_id].refined, found.row(object_id, answer)
    rows = [*range(min(_MOST, 0 if refined is None else len(refined.refined)))]
    swarms = []
    for row in dict.fromkeys(rows if chosen is None else [*rows, chosen]):
        rounds = search_again(detection, found, object_id, row)
        if rounds is not None:
            swarms.append(Swarm(rounds, row == chosen))
    if not swarms:
        return None
    model, settings = detection.dataset.models[object_id], detection.settings.refinement
    assert isinstance(settings, PsoSettings)  # of others, no search can be repeated
    seen = _observation(settings, found)

    def own_cost(pose_cam_obj: Float[np.ndarray, "4 4"]) -> float:
        """In a search that starts from the pose: others may look at another place."""
        cost = cost_around(model, seen, pose_cam_obj, settings.cost)
        return float(cost.evaluate(pose_cam_obj[None])[0])

    pose = None if answer is None else answer.pose_cam_obj
    return SwarmsOfTarget(
        f"{model.name} {found.frame.key}: {verdict}",
        swarms,
        own_cost(target.pose_cam_obj),
        None if pose is None else own_cost(pose),
    )


def search_again(
    detection: DetectionStages, found: FrameResults, object_id: int, row: int
) -> Float[np.ndarray, "rounds particles"] | None:
    """Costs of all particles in the search that one of an object's refined poses comes from.

    None if the search cannot be repeated with the same pose as end: it had another refiner or a
    time budget, or comes from the fallback, whose coarse poses are not kept.
    """
    settings = detection.settings.refinement
    refined, coarse = found.trace[object_id].refined, found.trace[object_id].hypotheses
    assert refined is not None and coarse is not None
    source = int(refined.sources[row])
    if not isinstance(settings, PsoSettings) or source < 0:
        return None
    model: ObjectModel = detection.dataset.models[object_id]
    start, stored = coarse.poses_cam_obj[source], refined.refined[row].pose_cam_obj
    seen = _observation(settings, found)
    edges = seen.edges_of(model)
    cost = RecordedCost(model.proxy, seen.depth, seen.camera_matrix, start, settings.cost, edges)
    rng = np.random.default_rng(refined.seeds[row])
    pose, iterations = search(cost, start, model.centroid, settings, rng)
    if not np.array_equal(pose, stored):  # it was chosen, so that it was moved further
        pose = choose_sibling(seen, model, pose).pose_cam_obj
        # The first refinement of a look has the seed of the look, as its last one has.
        refiner, seed = settings.build(threads=1), int(refined.seeds[0][0])
        before = Refinement(pose, iterations)
        polished = refiner.polish(model, seen, before, seed)
        ends = (pose, polished.pose_cam_obj)
        if not any(np.array_equal(end, stored) for end in ends):
            return None
    return np.stack(cost.rounds)


def _observation(settings: PsoSettings, found: FrameResults) -> Observation:
    frame = found.frame
    return observe(frame.rgb, frame.depth, frame.camera_matrix, settings.verification)
