"""The search for objects in one frame, stage by stage: everything that finds objects uses it."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hlp.method.find.estimator import FrameContext
from hlp.method.find.instances import find_instances, resolve_conflicts
from hlp.method.find.trace import ObjectTrace, Stage, Trace
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.score_model import MIN_SCORE
from hlp.refinement.verification import Observation
from hlp.threads import ThreadTeam

MOST_INSTANCES = 10
"""Instances of one object that are looked for in an image where their number is not known."""
_LIKELIEST = 8  # windows by which it is judged whether an object is there
_FEW_PATCHES = 0.25  # of all: enough for most objects in plain view (D)
_FEW_POSES = 20  # those with most votes (D)
_SURE_ALONE = 0.995  # score of a pose that no other is compared with: one turned over may score .99
_MAY_BE_SURE = 0.4  # mean in the likeliest windows: with .2, a weak network gave a sure wrong pose
_CALLER = ThreadTeam(1)


def search_frame(
    context: FrameContext,
    counts: Mapping[int, int],
    *,
    min_score: float | None = None,
    unexplained: Observation | None = None,
    fallback: bool = True,
    given: Trace | None = None,
    stop_after: Stage = "poses",
    by_threads: bool = True,
    recorded: bool = False,
    begun: float | None = None,
) -> Trace:
    """Search for objects in the frame of a context; what was found of each, stage by stage.

    `counts` maps object ids to numbers of instances. They are known to be there; with `min_score`
    they are the most that are looked for, as long as answers have that score. `unexplained` is the
    frame without what is known to be there (None: nothing is). Without `fallback` the first look at
    an object is the only one, and no score is needed. `given` regions and hypotheses, true ones or
    those of an earlier search, are not searched again. `stop_after` is the last stage.

    The threads of the estimator search different objects. With `by_threads` off, one object is
    searched after another, so that the seconds of each are its own; poses are the same. Work since
    `begun` (`time.perf_counter`), and what objects share, counts for the first one. An object that
    is found soon needs no coarse poses; they are made nevertheless if they are to be `recorded`.
    """
    begun = time.perf_counter() if begun is None else begun
    search = _FrameSearch(context, counts, min_score, unexplained, fallback, by_threads, recorded)
    if by_threads:
        context.estimator.share_work(context, counts)
    traces = search.find_regions(given or {}, time.perf_counter() - begun)
    if stop_after == "regions":
        return traces
    traces = search.find_poses(traces, stop_after)
    return traces if stop_after == "hypotheses" else search.settle(traces)


@dataclass(frozen=True)
class _FrameSearch:
    """A search in one frame: what `search_frame` was given."""

    context: FrameContext
    counts: Mapping[int, int]
    min_score: float | None
    unexplained: Observation | None
    fallback: bool
    by_threads: bool
    recorded: bool

    def _each(
        self, object_ids: Sequence[int], work: Callable[[int], ObjectTrace]
    ) -> dict[int, ObjectTrace]:
        """What is done with each object, by the threads."""
        team = self.context.estimator.team if self.by_threads else _CALLER
        done = team.map(lambda place: work(object_ids[place]), len(object_ids))
        return dict(zip(object_ids, done, strict=True))

    def find_regions(self, given: Trace, shared: float) -> dict[int, ObjectTrace]:
        """Stage 1 (paper, section 3.1). `shared` seconds were spent for all objects before."""

        def find(object_id: int) -> ObjectTrace:
            if object_id in given:
                return given[object_id]
            begun = time.perf_counter() - shared * (object_id in [*self.counts][:1])
            # Where their number is known, instances that one look has missed are looked for anew.
            instances = 1 if self.min_score is None else self.counts[object_id]
            region = self.context.estimator.find_region(self.context, object_id, instances)
            return ObjectTrace(region, seconds={"holistic": time.perf_counter() - begun})

        return self._each([*self.counts], find)

    def find_poses(self, traces: dict[int, ObjectTrace], last: Stage) -> dict[int, ObjectTrace]:
        """Stages 2 and 3 of each object, as if it were alone; stage 2 alone if that is the last."""
        order, begun = list(traces), time.perf_counter()
        first, shared = order[:1], 0.0
        if self.by_threads:
            self.context.estimator.share_patches(self.context, map(_region, traces.values()))
            shared = time.perf_counter() - begun
            # Objects that the classifier is least sure of take longest: no thread then waits long
            # for the others at the end of the frame.
            order = sorted(order, key=lambda object_id: _evidence(_region(traces[object_id])))

        def find(object_id: int) -> ObjectTrace:
            trace, soon = traces[object_id], ObjectTrace()
            if last == "poses":
                soon = self._find_soon(object_id, _region(trace))
            if trace.hypotheses is None and (soon.refined is None or self.recorded):
                found = self.context.estimator.find_hypotheses(self.context, _region(trace))
                own = _added(found.seconds, {"local": shared * (object_id in first)})
                spent = {} if soon.refined is not None else own
                trace = replace(found, seconds=_added(trace.seconds, spent))
            trace = replace(trace, seconds=_added(trace.seconds, soon.seconds))
            if last == "hypotheses" or soon.refined is not None:
                return replace(trace, refined=soon.refined)
            begun = time.perf_counter()
            refined = self._find_instances(object_id, trace, self.unexplained)
            spent = {"refinement": time.perf_counter() - begun}
            return replace(trace, refined=refined, seconds=_added(trace.seconds, spent))

        found = self._each(order, find)
        return {object_id: found[object_id] for object_id in traces}

    def _find_soon(self, object_id: int, region: Region) -> ObjectTrace:
        """Stages 2 and 3 with few patches; `refined` is None unless that gives one sure pose.

        That is enough for most objects in plain view. More than one instance, and what has no
        colours or looks alike from all sides, is left to the search with all patches.
        """
        context, estimator = self.context, self.context.estimator
        several = self.counts[object_id] > 1 and self.min_score is None
        unlikely = several or not self.fallback or _evidence(region) < _MAY_BE_SURE
        if unlikely or not estimator.may_be_found_soon(object_id):
            return ObjectTrace()
        found = estimator.find_hypotheses(context, region, _FEW_PATCHES)
        coarse = found.hypotheses
        assert coarse is not None
        begun, least = time.perf_counter(), max(self.min_score or 0.0, MIN_SCORE)
        few = Hypotheses(coarse.poses_cam_obj[:_FEW_POSES], coarse.support[:_FEW_POSES])
        of = context, object_id, few, self.counts[object_id], self.unexplained
        refined = estimator.refine(*of, self.min_score, candidates=1)
        poses = [] if refined is None else refined.chosen_poses
        scores = np.array([context.fits.score(object_id, pose) for pose in poses])
        spent = {**found.seconds, "refinement": time.perf_counter() - begun}
        if refined is None or np.count_nonzero(scores >= least) != 1 or scores[0] < _SURE_ALONE:
            return ObjectTrace(seconds=spent)
        answer = self._doubted(object_id, refined.from_elsewhere())
        return ObjectTrace(refined=answer, seconds=spent)

    def _doubted(self, object_id: int, found: RefinedHypotheses | None) -> RefinedHypotheses | None:
        """What was found, with scores that know whether the object may be absent."""
        if found is not None and self.min_score is not None:
            self.context.fits.doubt(object_id, found.chosen_poses)
        return found

    def _find_instances(
        self, object_id: int, trace: ObjectTrace, unexplained: Observation | None
    ) -> RefinedHypotheses | None:
        """Stage 3 (section 3.3): fine poses, and which of them are instances."""
        if trace.hypotheses is None:  # were not needed before
            trace = self.context.estimator.find_hypotheses(self.context, _region(trace))
        assert trace.hypotheses is not None
        of = self.context, _region(trace), trace.hypotheses, self.counts[object_id]
        found = find_instances(*of, unexplained, self.min_score, fallback=self.fallback)
        return self._doubted(object_id, found)

    def settle(self, traces: dict[int, ObjectTrace]) -> dict[int, ObjectTrace]:
        """Objects compete for pixels; then the fit of each instance that is left is settled."""
        begun = time.perf_counter()
        found = resolve_conflicts(
            self.context,
            {object_id: trace.refined for object_id, trace in traces.items()},
            lambda object_id, left: self._find_instances(object_id, traces[object_id], left),
            self.min_score,
            self.unexplained,
        )
        fits = self.context.fits
        fits.settle(
            [
                (object_id, pose)
                for object_id, refined in found.items()
                for pose in ([] if refined is None else refined.chosen_poses)
            ]
        )
        share = (time.perf_counter() - begun) / max(len(traces), 1)

        def measure(object_id: int) -> ObjectTrace:
            begun = time.perf_counter()
            refined, spent = found[object_id], traces[object_id].seconds
            poses = () if refined is None else refined.chosen_poses
            own = tuple(fits.measure(object_id, pose) for pose in poses)
            more = {"refinement": spent["refinement"] + share + time.perf_counter() - begun}
            return replace(traces[object_id], refined=refined, fits=own, seconds={**spent, **more})

        return self._each([*traces], measure)


def _region(trace: ObjectTrace) -> Region:
    assert trace.region is not None
    return trace.region


def _evidence(region: Region) -> float:
    """How sure the classifier is that the object is there: its mean in the likeliest windows."""
    likeliest = np.sort(region.probabilities)[-_LIKELIEST:]
    return float(likeliest.mean()) if len(likeliest) else 0.0


def _added(seconds: Mapping[str, float], more: Mapping[str, float]) -> dict[str, float]:
    """The seconds of each step, with more."""
    steps = [*seconds, *(step for step in more if step not in seconds)]
    return {step: seconds.get(step, 0.0) + more.get(step, 0.0) for step in steps}
