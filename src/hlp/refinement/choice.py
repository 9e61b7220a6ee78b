"""Stage 3 of one object: choose the hypotheses to refine, and the refined ones that are instances.

Instances are chosen one after another. A later one must not stand on pixels of those before.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Int

from hlp.arrays import Flags, Pose, Poses, Rows, Values
from hlp.records import Hypotheses
from hlp.refinement.pose_fit import measure_fit
from hlp.refinement.refiner import Refinement, Refiner, refinable
from hlp.refinement.score_model import ScoreModel
from hlp.refinement.texture import choose_by_texture
from hlp.refinement.verification import Evidence, Observation, Verifier

_FURTHER = 4  # hypotheses refined for one more instance where their number is not known
_HOPELESS = 0.1  # if the best of the first two of these scores less, the others are left out
_GIVEN_UP_SHARE = 0.03  # of min_score: a hypothesis that soon scores less is given up (D)
_SURE = 0.9  # score of a pose beside which no others are refined (D)
_IF_THERE = 8  # hypotheses refined at first of an object with colours that may be absent (D)
_BATCH = 2  # hypotheses refined before the next ones are compared with the best so far


KnownRefinements = dict[bytes, Refinement]
"""Refinements by the bytes of the coarse pose."""


@dataclass(frozen=True)
class RefinedHypotheses:
    """The refined hypotheses of one object, and which of them were chosen.

    `refined[i]` was refined from the coarse hypothesis of index `sources[i]` and has the
    verification cost `costs[i]`, infinite if it stood on pixels of chosen instances only; a source
    of -1 means that the hypothesis is not among those that the region gave. Its pose is
    `starts[i]`. `instances` are the rows of the chosen ones, in the order of choice; there is at
    least one.
    """

    refined: list[Refinement]
    costs: Values
    sources: Int[np.ndarray, "c"]
    starts: Poses
    instances: tuple[int, ...]

    def from_elsewhere(self) -> "RefinedHypotheses":
        """The same, of hypotheses that are not among those that the region gave."""
        return replace(self, sources=np.full_like(self.sources, -1))

    @property
    def chosen_poses(self) -> list[Pose]:
        """The poses of the instances, in the order of choice."""
        return [self.refined[row].pose_cam_obj for row in self.instances]


def choose_among_alike(verifier: Verifier, observation: Observation, pose_cam_obj: Pose) -> Pose:
    """The pose, or another one in which the object looks much alike.

    That of `ObjectModel.near_symmetries` whose colours agree best with the image. Of an object that
    is nearly of revolution the turn about its axis that costs least.
    """
    if len(verifier.turns) == 1:
        return choose_by_texture(observation, verifier.model, pose_cam_obj)
    poses = pose_cam_obj @ verifier.turns
    return np.asarray(poses[np.argmin(verifier.costs(observation, poses))])


@dataclass
class InstanceSearch:
    """Refines the most promising hypotheses, chooses those of lowest verification cost.

    Hypotheses that are not finite or lie behind the camera are dropped. The rest is refined in
    order of verification cost, two at a time and at most `candidates` (None: the verifier's), until
    the best is sure, or the next one costs more than it by `max_improvement`: refinement hardly
    ever lowers a cost by that much. The best of those that look much like the chosen one takes its
    place (`choose_among_alike`). Then it is searched again, in a smaller box; what that finds is
    kept unless its cost, among the refined poses, is higher than before.

    This is repeated for every further instance, with the hypotheses for which more than half of the
    agreeing pixels are not explained by an instance that was chosen before. `unexplained` is the
    observation without what other objects explain already (None: they explain nothing). `score` is
    that of a pose. With a `min_score` the number of instances is not known: one below it is the
    last, and a further one is given up early where the first poses are hopeless. With an
    `early_score`, fewer are refined, and one is given up whose shape soon scores hopelessly little.
    `known` are refinements of coarse poses of the object in the image, by the bytes of the pose:
    they are not made again, and new ones are added. `enter` is called with each part that begins:
    refine, verify or second_search.
    """

    refiner: Refiner
    verifier: Verifier
    observation: Observation
    hypotheses: Hypotheses
    seed: int
    unexplained: Observation | None = None
    score: Callable[[Pose], float] = lambda pose: 0.0
    min_score: float | None = None
    enter: Callable[[str], None] = lambda part: None
    candidates: int | None = None
    early_score: ScoreModel | None = None
    known: KnownRefinements = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._begun = time.perf_counter()
        self._model = self.verifier.model
        self._support = self.hypotheses.support
        self._poses = np.asarray(self.hypotheses.poses_cam_obj, dtype=np.float64)
        usable = np.flatnonzero(refinable(self._poses, self._model.centroid))
        found = self.verifier.evidence(self.observation, self._poses[usable])
        costs = self.verifier.weigh(found)
        ranking = np.argsort(costs, kind="stable")
        self._order = usable[ranking]
        self._evidence = Evidence(*(values[ranking] for values in found))
        self._refined: list[Refinement] = []
        self._sources: list[int] = []
        self._costs = np.zeros(0)
        self._instances: list[int] = []
        self._judged: dict[bytes, tuple[float, ...]] = {}  # evidence for refined poses
        self._free: dict[int, bool] = {}  # refined ones, until an instance takes pixels

    def find(self, instances: int = 1) -> RefinedHypotheses | None:
        """Refine and choose, for up to so many instances; None if nothing was chosen."""
        for _ in range(instances):
            row = self._choose_next()
            if row is None or self._scores_below(row):
                break
        if not self._instances:
            return None
        sources = np.array(self._sources)
        found = self._refined, self._costs, sources, self._poses[sources]
        return RefinedHypotheses(*found, tuple(self._instances))

    def _scores_below(self, row: int, limit: float = 1.0) -> bool:
        """Whether the number is not known, and a refined pose scores less than both limits."""
        pose, least = self._refined[row].pose_cam_obj, self.min_score
        return least is not None and self.score(pose) < min(limit, least)

    def _is_hopeless(self, row: int) -> bool:
        """Whether a pose shows that there is no further instance; the first one is looked for."""
        return bool(self._instances) and self._scores_below(row, _HOPELESS)

    def _is_sure(self, row: int) -> bool:
        """Whether a pose is surely right. Scores tell little of turns, or without colours."""
        found = self._refined[row]
        if found.given_up or len(self.verifier.turns) > 1 or not self._model.mesh.colored:
            return False
        return self.score(found.pose_cam_obj) >= _SURE

    def _is_given_up(self, pose_cam_obj: Pose) -> bool:
        """Whether a pose fits too badly to become an answer, judged by shape alone.

        Colours contradict a pose that is not exact yet. Objects without colours have no such score:
        it depends on other answers.
        """
        assert self.early_score is not None
        of = self.verifier, self.observation, pose_cam_obj
        fit = measure_fit(*of, with_colors=False)
        return self.early_score.score(fit) < _GIVEN_UP_SHARE * (self.min_score or 0.0)

    def _choose_next(self) -> int | None:
        """Refine what may be next, choose one, search again about it; its row, None without any."""
        if self._instances:
            before = self.observation if self.unexplained is None else self.unexplained
            last = self._refined[self._instances[-1]].pose_cam_obj
            self.unexplained = self.verifier.without_explained(before, last)
            self._free = {row: False for row, free in self._free.items() if not free}
        self._refine()
        added = np.full(len(self._refined) - len(self._costs), np.inf)
        self._costs = np.append(self._costs, added)
        rows = self._free_refined()
        if len(rows) == 0:
            return None
        self._costs[rows] = self._competing_costs(rows)
        row = int(rows[np.argmin(self._costs[rows])])
        refined = self._refined[row]
        pose = choose_among_alike(self.verifier, self.observation, refined.pose_cam_obj)
        if pose is not refined.pose_cam_obj:
            self._refined[row] = replace(refined, pose_cam_obj=pose)
            self._costs[rows] = self._competing_costs(rows)
        if not (self._refined[row].given_up or self._is_hopeless(row)):
            self._search_again(row, rows)
        self._instances.append(row)
        return row

    def _refine(self) -> None:
        """Refine free hypotheses in order of cost until one is sure, or the next ones hopeless."""
        candidates = self.candidates or self.verifier.settings.candidates
        if self._instances and self.min_score is not None:
            candidates = min(candidates, _FURTHER)  # most such searches find none
        elif self.early_score is not None:
            candidates = min(candidates, _IF_THERE)
        self._keep_coarse(~np.isin(self._order, self._sources))
        self._keep_coarse(self._is_free(self._poses[self._order], self._evidence))
        order, coarse_costs = self._order[:candidates], self.verifier.weigh(self._evidence)
        lowest, best = self._lowest_cost(self._free_refined())
        for start in range(0, len(order), _BATCH):
            if coarse_costs[start] - self.verifier.settings.max_improvement > lowest:
                break
            if start > 0 and best is not None and (self._is_hopeless(best) or self._is_sure(best)):
                break
            rows = self._refine_batch(order[start : start + _BATCH])
            lowest, best = min((lowest, best), self._lowest_cost(rows), key=lambda each: each[0])

    def _keep_coarse(self, rows: Flags) -> None:
        """Keep some of the coarse poses that are not refined yet, in order of cost."""
        self._order = self._order[rows]
        self._evidence = Evidence(*(values[rows] for values in self._evidence))

    def _refine_batch(self, rows: Rows) -> Rows:
        """Refine the hypotheses of these rows, but for those that are known; the refined rows."""
        keys = [self._poses[row].tobytes() for row in rows]
        new = [row for row, key in zip(rows, keys, strict=True) if key not in self.known]
        if new:
            batch = Hypotheses(self._poses[new], self._support[new])
            # The refiner numbers each batch's hypotheses from 0.
            batch_seed = self.seed + len(self._refined)
            self.enter("refine")
            of = self._model, self.observation, batch, batch_seed, self._spent()
            found = self.refiner.refine(*of, self._is_given_up if self.early_score else None)
            self.enter("verify")
            for row, refined in zip(new, found, strict=True):
                self.known[self._poses[row].tobytes()] = refined
        self._refined += [self.known[key] for key in keys]
        self._sources += rows.tolist()
        return np.arange(len(self._refined) - len(rows), len(self._refined))

    def _search_again(self, row: int, rows: Rows) -> None:
        """Search again about the chosen one of the free `rows`; what fits less well is dropped.

        It may fit less well, because the refiner's cost is not the verifier's.
        """
        before = self._refined[row]
        self.enter("second_search")
        self._refined[row] = self.refiner.second_search(
            self._model, self.observation, before, self._spent()
        )
        self.enter("verify")
        cost = self._competing_costs(rows)[np.flatnonzero(rows == row)[0]]
        if cost > self._costs[row]:
            self._refined[row] = before
        else:
            self._costs[row] = cost

    def _lowest_cost(self, rows: Rows) -> tuple[float, int | None]:
        """The lowest cost of these refined poses, infinite without any, and its row."""
        if len(rows) == 0:
            return np.inf, None
        costs = self.verifier.weigh(self._evidence_for(self._refined_poses(rows)))
        return float(costs.min()), int(rows[np.argmin(costs)])

    def _competing_costs(self, rows: Rows) -> Values:
        support = self._support[np.array(self._sources)[rows]]
        poses = self._refined_poses(rows)
        return self.verifier.competing_costs(self._evidence_for(poses), poses, support)

    def _free_refined(self) -> Rows:
        """Rows of refined poses that are neither chosen nor stand on pixels of chosen ones."""
        new = [row for row in range(len(self._refined)) if row not in self._free]
        if new:
            poses = self._refined_poses(np.array(new))
            free = self._is_free(poses, self._evidence_for(poses))
            self._free |= dict(zip(new, free.tolist(), strict=True))
        left = {row for row, free in self._free.items() if free} - {*self._instances}
        return np.array(sorted(left), dtype=np.int64)

    def _is_free(self, poses_cam_obj: Poses, evidence: Evidence) -> Flags:
        if self.unexplained is None:
            return np.ones(len(poses_cam_obj), dtype=bool)
        return self.verifier.is_free(self.unexplained, poses_cam_obj, evidence)

    def _evidence_for(self, poses_cam_obj: Poses) -> Evidence:
        """How the image agrees with refined poses, each compared with it once."""
        keys = [pose.tobytes() for pose in poses_cam_obj]
        if new := [row for row, key in enumerate(keys) if key not in self._judged]:
            found = zip(*self.verifier.evidence(self.observation, poses_cam_obj[new]), strict=True)
            self._judged |= {keys[row]: each for row, each in zip(new, found, strict=True)}
        return Evidence(*np.array([self._judged[key] for key in keys]).T)

    def _refined_poses(self, rows: Rows) -> Poses:
        return np.array([self._refined[row].pose_cam_obj for row in rows]).reshape(-1, 4, 4)

    def _spent(self) -> float:
        return time.perf_counter() - self._begun
