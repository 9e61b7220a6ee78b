"""Stage 3 of one object: choose the hypotheses to refine, and the refined ones that are instances.

Instances are chosen one after another. A later one must not stand on pixels that those before it
explain.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from hlp.observer import NOBODY, Observer
from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.refiner import Refiner, refinable
from hlp.refinement.texture import choose_sibling
from hlp.refinement.verification import Evidence, Observation, Verifier

_FURTHER = 4  # hypotheses refined for one more instance where their number is not known
_BATCH = 2  # hypotheses refined before the next ones are compared with the best so far


@dataclass(frozen=True)
class RefinedHypotheses:
    """The refined hypotheses of one object, and which of them were chosen.

    `refined[i]` was refined from the coarse hypothesis of index `sources[i]` and has the
    verification cost `costs[i]`, infinite if it stood on pixels of chosen instances only; a source
    of -1 means that the hypothesis is not among those that the region gave. `seeds[i]` is the seed
    of the refiner's call and the hypothesis' number in it, by which the search can be repeated.
    `instances` are the rows of the chosen ones, in the order of choice; there is at least one.
    """

    refined: list[Refinement]
    costs: Float[np.ndarray, "c"]
    sources: Int[np.ndarray, "c"]
    seeds: Int[np.ndarray, "c 2"]
    instances: tuple[int, ...]

    @property
    def best(self) -> int:
        """The row of the instance that was chosen first."""
        return self.instances[0]

    @property
    def chosen_poses(self) -> list[Float[np.ndarray, "4 4"]]:
        """The poses of the instances, in the order of choice."""
        return [self.refined[row].pose_cam_obj for row in self.instances]


def refine_and_choose(
    refiner: Refiner,
    verifier: Verifier,
    observation: Observation,
    model: ObjectModel,
    hypotheses: Hypotheses,
    candidates: int,
    max_improvement: float,
    seed: int,
    instances: int = 1,
    unexplained: Observation | None = None,
    good_enough: Callable[[Float[np.ndarray, "4 4"]], bool] | None = None,
    observer: Observer = NOBODY,
) -> RefinedHypotheses | None:
    """Refine the most promising hypotheses, choose those of lowest verification cost, polish them.

    Hypotheses that are not finite or lie behind the camera are dropped, and those that are not
    likely (`Verifier.are_likely`); None if no other is left. The rest is refined in order of
    verification cost, two at a time and at most `candidates`, until the next one costs more than
    the best refined pose by `max_improvement`: refinement hardly ever lowers a cost by that much.
    The chosen pose gives way to that of its siblings whose colours agree best with the image. Then
    it is polished; the polished pose is kept unless its cost, among the refined poses, is higher
    than before.

    This is repeated for every further one of up to `instances`, with the hypotheses for which more
    than half of the agreeing pixels are not explained by an instance that was chosen before.
    `unexplained` is the observation without what other objects explain already (None: they explain
    nothing). An instance whose pose is not `good_enough` is the last one.
    """
    search = _InstanceSearch(
        refiner, verifier, observation, model, hypotheses, seed, unexplained, observer
    )
    for number in range(instances):
        # Most searches for one more instance find none: they are kept short.
        tried = min(candidates, _FURTHER) if number > 0 and good_enough is not None else candidates
        chosen = search.choose_next(tried, max_improvement)
        if chosen is None or (good_enough is not None and not good_enough(chosen)):
            break
    return search.result()


class _InstanceSearch:
    """Refines hypotheses as far as they are needed, and chooses one instance after another."""

    def __init__(
        self,
        refiner: Refiner,
        verifier: Verifier,
        observation: Observation,
        model: ObjectModel,
        hypotheses: Hypotheses,
        seed: int,
        unexplained: Observation | None,
        observer: Observer,
    ) -> None:
        self._observer = observer
        self._begun = time.perf_counter()
        self._refiner, self._verifier, self._model = refiner, verifier, model
        self._observation, self._seed = observation, seed
        self._unexplained = unexplained
        poses = np.asarray(hypotheses.poses_cam_obj, dtype=np.float64)
        usable = np.flatnonzero(refinable(poses, model.centroid))
        found = verifier.evidence(observation, poses[usable])
        costs = verifier.weigh(found)
        ranking = np.argsort(costs, kind="stable")
        ranking = ranking[verifier.are_likely(costs, hypotheses.support[usable])[ranking]]
        self._order, self._evidence = usable[ranking], found.rows(ranking)
        self._poses, self._support = poses, hypotheses.support
        self._refined: list[Refinement] = []
        self._sources: list[int] = []
        self._seeds: list[tuple[int, int]] = []
        self._costs = np.zeros(0)
        self._instances: list[int] = []

    def result(self) -> RefinedHypotheses | None:
        """What was refined and chosen so far; None if nothing was chosen."""
        if not self._instances:
            return None
        sources, seeds = np.array(self._sources), np.array(self._seeds)
        chosen = tuple(self._instances)
        return RefinedHypotheses(self._refined, self._costs, sources, seeds, chosen)

    def choose_next(
        self, candidates: int, max_improvement: float
    ) -> Float[np.ndarray, "4 4"] | None:
        """Refine what may be the next instance, choose and polish it; None if there is none."""
        if self._instances:
            self._explain(self._refined[self._instances[-1]].pose_cam_obj)
        self._refine(candidates, max_improvement)
        added = np.full(len(self._refined) - len(self._costs), np.inf)
        self._costs = np.append(self._costs, added)
        rows = np.flatnonzero(self._free_refined())
        if len(rows) == 0:
            return None
        costs = self._competing_costs(rows)
        self._costs[rows] = costs
        chosen = int(np.argmin(costs))
        if len(self._model.siblings) > 0:
            self._turn_to_sibling(int(rows[chosen]))
            self._costs[rows] = self._competing_costs(rows)
        self._polish(rows, chosen)
        return self._refined[self._instances[-1]].pose_cam_obj

    def _refine(self, candidates: int, max_improvement: float) -> None:
        """Refine free hypotheses in order of cost until the next one is hopeless."""
        coarse_costs = self._verifier.weigh(self._evidence)
        free = self._is_free(self._poses[self._order], self._evidence)
        free &= ~np.isin(self._order, self._sources)
        order, coarse_costs = self._order[free][:candidates], coarse_costs[free]
        before = self._refined_poses(np.flatnonzero(self._free_refined()))
        costs = self._verifier.costs(self._observation, before)
        lowest = float(costs.min(initial=np.inf))
        for start in range(0, len(order), _BATCH):
            if coarse_costs[start] - max_improvement > lowest:
                break
            rows = order[start : start + _BATCH]
            batch = Hypotheses(self._poses[rows], self._support[rows])
            # The refiner numbers each batch's hypotheses from 0.
            batch_seed = self._seed + len(self._refined)
            self._observer.enter("refine")
            found = self._refiner.refine(
                self._model, self._observation, batch, batch_seed, self._spent()
            )
            self._observer.enter("verify")
            self._refined += found
            self._sources += rows.tolist()
            self._seeds += [(batch_seed, number) for number in range(len(rows))]
            poses = np.stack([each.pose_cam_obj for each in found])
            lowest = min(lowest, self._verifier.costs(self._observation, poses).min())

    def _turn_to_sibling(self, row: int) -> None:
        """Replace a refined pose by that of its siblings whose colours agree best."""
        before = self._refined[row]
        told = choose_sibling(self._observation, self._model, before.pose_cam_obj)
        self._refined[row] = replace(before, pose_cam_obj=told.pose_cam_obj)

    def _polish(self, rows: Int[np.ndarray, "r"], chosen: int) -> None:
        """Add the chosen one of the free `rows` to the instances, polished.

        The refiner's cost is not the verifier's, so a polished pose may fit the image less well; it
        is then dropped.
        """
        row = int(rows[chosen])
        before = self._refined[row]
        self._observer.enter("polish")
        self._refined[row] = self._refiner.polish(
            self._model, self._observation, before, self._seed, self._spent()
        )
        self._observer.enter("verify")
        cost = self._competing_costs(rows)[chosen]
        if cost > self._costs[row]:
            self._refined[row] = before
        else:
            self._costs[row] = cost
        self._instances.append(row)

    def _competing_costs(self, rows: Int[np.ndarray, "r"]) -> Float[np.ndarray, "r"]:
        support = self._support[np.array(self._sources)[rows]]
        poses = self._refined_poses(rows)
        return self._verifier.competing_costs(self._observation, poses, support)

    def _explain(self, pose_cam_obj: Float[np.ndarray, "4 4"]) -> None:
        before = self._observation if self._unexplained is None else self._unexplained
        self._unexplained = self._verifier.without_explained(before, pose_cam_obj)

    def _free_refined(self) -> Bool[np.ndarray, "c"]:
        """Which refined poses are neither chosen nor stand on pixels of chosen ones."""
        poses = self._refined_poses(np.arange(len(self._refined)))
        free = self._is_free(poses, None)
        free[self._instances] = False
        return free

    def _is_free(
        self, poses_cam_obj: Float[np.ndarray, "n 4 4"], evidence: Evidence | None
    ) -> Bool[np.ndarray, "n"]:
        if self._unexplained is None:
            return np.ones(len(poses_cam_obj), dtype=bool)
        if evidence is None:
            evidence = self._verifier.evidence(self._observation, poses_cam_obj)
        return self._verifier.is_free(self._unexplained, poses_cam_obj, evidence)

    def _refined_poses(self, rows: Int[np.ndarray, "r"]) -> Float[np.ndarray, "r 4 4"]:
        poses = [self._refined[row].pose_cam_obj for row in rows]
        return np.stack(poses) if poses else np.zeros((0, 4, 4))

    def _spent(self) -> float:
        return time.perf_counter() - self._begun
