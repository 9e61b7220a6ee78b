"""The objects of a frame are searched by several threads at once."""

import threading
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from hlp.method.find.search import search_frame
from hlp.method.find.trace import STEPS, ObjectTrace
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.refiner import Refinement
from hlp.threads import ThreadTeam


class Estimator:
    """Finds nothing of any object; waits in stage 2 until `at_once` objects are searched."""

    def __init__(self, threads, at_once, probability=None):
        self.team = ThreadTeam(threads)
        self.done = []
        self.searched = []
        self._probability = probability or {}
        self._barrier = threading.Barrier(at_once, timeout=10)

    def share_work(self, context, object_ids):
        self.done.append(("shared", object_ids))

    def find_region(self, context, object_id, instances):
        self.done.append((object_id, instances))
        seen = [self._probability[object_id]] if object_id in self._probability else []
        centers, nowhere = np.zeros((len(seen), 2)), np.zeros((4, 4), dtype=bool)
        return Region(object_id, centers, np.array(seen), nowhere)

    def share_patches(self, context, regions):
        self.done.append(("shared patches", sorted(region.object_id for region in regions)))

    def find_hypotheses(self, context, region):
        self.searched.append(region.object_id)
        self._barrier.wait()
        none = Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))
        return ObjectTrace(region, hypotheses=none, seconds={"local": 0.0, "voting": 0.0})

    def refine(self, *_):
        return None

    def verifier(self, _):
        return None

    def other_regions(self, *_):
        return iter(())

    def has_templates(self, object_id):
        return False

    def may_be_found_soon(self, object_id):
        return False


def search(estimator, counts, **options):
    return search_frame(SimpleNamespace(estimator=estimator, fits=Mock()), counts, **options)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_search_different_objects(threads):
    estimator = Estimator(threads, threads)
    counts = {5: 1, 3: 2, 9: 1, 4: 1, 8: 1, 2: 1}
    trace = search(estimator, counts, min_score=0.5)
    assert list(trace) == list(counts) and all(found.refined is None for found in trace.values())
    assert estimator.done[0] == ("shared", counts)
    assert dict(estimator.done[1:-1]) == counts
    assert estimator.done[-1] == ("shared patches", sorted(counts))
    assert search(estimator, {}, min_score=0.5) == {}


def test_what_the_classifier_is_least_sure_of_is_searched_first():
    """Answers stay in the order in which objects were asked for."""
    estimator = Estimator(1, 1, {5: 0.9, 3: 0.2, 9: 1.0, 4: 0.5})
    trace = search(estimator, dict.fromkeys((5, 3, 9, 7, 4), 1), min_score=0.5)
    assert estimator.searched == [7, 3, 4, 5, 9]
    assert [*trace] == [5, 3, 9, 7, 4]


def test_a_search_stops_after_a_stage_and_takes_what_is_given():
    estimator = Estimator(1, 1)
    counts = {5: 2, 3: 1}
    alone = {"by_threads": False}
    regions = search(estimator, counts, stop_after="regions", **alone)
    assert estimator.done == [(5, 1), (3, 1)] and estimator.searched == []
    assert all(found.hypotheses is None for found in regions.values())
    given = {5: regions[5]}
    coarse = search(estimator, counts, given=given, stop_after="hypotheses", **alone)
    assert estimator.done[2:] == [(3, 1)] and estimator.searched == [5, 3]
    assert coarse[5].region is regions[5].region and coarse[5].refined is None
    fine = search(estimator, counts, given=coarse, **alone)
    assert estimator.done[3:] == [] and estimator.searched == [5, 3]
    assert [*fine] == [5, 3] and set(fine[5].seconds) == set(STEPS)


@pytest.mark.parametrize("min_score", [None, 0.5])
def test_what_may_be_absent_is_doubted_before_it_takes_pixels_from_others(min_score, monkeypatch):
    happened = Mock()
    answer = SimpleNamespace(chosen_poses=[np.eye(4)])
    monkeypatch.setattr("hlp.method.find.search.find_instances", lambda *_, **__: answer)
    monkeypatch.setattr("hlp.method.find.search.resolve_conflicts", happened.resolve)
    happened.resolve.return_value = {5: None}
    context = SimpleNamespace(estimator=Estimator(1, 1), fits=happened)
    search_frame(context, {5: 1}, min_score=min_score, by_threads=False)
    calls = [name for name, *_ in happened.method_calls]
    assert calls == [*(["doubt"] if min_score else []), "resolve", "settle"]


def test_what_is_left_of_all_objects_is_measured_together_before_each_fit(monkeypatch):
    """Colours or not: what hides a part may be an instance of another object."""
    poses = {5: [np.eye(4), 2.0 * np.eye(4)], 3: [3.0 * np.eye(4)], 9: []}
    left = {i: SimpleNamespace(chosen_poses=own) if own else None for i, own in poses.items()}
    monkeypatch.setattr("hlp.method.find.search.resolve_conflicts", lambda *_: left)
    fits = Mock(measure=lambda object_id, pose: (object_id, pose[0, 0]))
    context = SimpleNamespace(estimator=Estimator(1, 1), fits=fits)
    trace = search_frame(context, dict.fromkeys(poses, 2), by_threads=False)
    (among,) = fits.settle.call_args.args
    assert [(i, pose[0, 0]) for i, pose in among] == [(5, 1.0), (5, 2.0), (3, 3.0)]
    assert [found.fits for found in trace.values()] == [((5, 1.0), (5, 2.0)), ((3, 3.0),), ()]


class Soon(Estimator):
    """Finds poses whose scores are `soon` with few patches and `late` with all; notes `shares`."""

    def __init__(self, soon, late, probability=0.9):
        super().__init__(1, 1, {5: probability})
        self.looks, self.shares = [soon, late], []

    def may_be_found_soon(self, object_id):
        return True

    def find_hypotheses(self, context, region, share=1.0):
        self.shares.append(share)
        poses = np.tile(share * np.eye(4), (30, 1, 1))
        found = Hypotheses(poses, np.ones(30))
        return ObjectTrace(region, hypotheses=found, seconds={"local": share, "voting": share})

    def refine(self, _, __, hypotheses, *___, **____):
        share = hypotheses.poses_cam_obj[0, 0, 0]
        scores = self.looks[int(share == 1.0)]
        assert len(hypotheses) == (30 if share == 1.0 else 20)
        poses = np.array([score * np.eye(4) for score in scores])
        found, rows = [Refinement(pose, 1) for pose in poses], np.arange(len(scores))
        return (
            RefinedHypotheses(found, np.zeros(len(rows)), rows, poses, tuple(rows))
            if len(rows)
            else None
        )

    def scores_found(self, counts, **options):
        """The scores of what is chosen, and the trace of object 5."""
        fits = Mock(score=lambda _, pose: pose[0, 0])
        context = SimpleNamespace(estimator=self, fits=fits)
        found = search_frame(context, counts, by_threads=False, **options)[5]
        return [pose[0, 0] for pose in found.refined.chosen_poses], found


@pytest.mark.parametrize(
    ("soon", "count", "min_score", "probability", "shares"),
    [
        ([0.997], 1, None, 0.9, [0.25]),
        ([0.997, 0.1], 9, 0.5, 0.9, [0.25]),  # no second one is probably right
        ([0.997, 0.6], 9, 0.5, 0.9, [0.25, 1.0]),
        ([0.99], 1, None, 0.9, [0.25, 1.0]),
        ([], 1, 0.5, 0.9, [0.25, 1.0]),
        ([0.997], 1, None, 0.3, [1.0]),  # hardly there
        ([0.997], 2, None, 0.9, [1.0]),  # several are known to be there
    ],
)
def test_few_patches_do_for_one_sure_pose(soon, count, min_score, probability, shares):
    estimator = Soon(soon, [0.8], probability)
    chosen, found = estimator.scores_found({5: count}, min_score=min_score)
    assert estimator.shares[: len(shares)] == shares
    assert chosen[0] == (0.997 if shares == [0.25] else 0.8)
    assert (found.hypotheses is None) == (shares == [0.25])
    assert found.seconds["local"] == sum(shares)


def test_what_is_recorded_changes_no_answer_and_takes_no_time_of_its_own():
    """Nor does it matter whether coarse poses are known already."""
    quick, recorded, given = (Soon([0.997], [0.8]) for _ in range(3))
    alone, before = quick.scores_found({5: 1})
    chosen, after = recorded.scores_found({5: 1}, recorded=True)
    assert chosen == alone == [0.997] and recorded.shares == [0.25, 1.0]
    assert len(after.hypotheses) == 30 and after.refined.sources.tolist() == [-1]
    assert after.seconds["local"] == before.seconds["local"] == 0.25
    assert given.scores_found({5: 1}, given={5: after})[0] == alone
