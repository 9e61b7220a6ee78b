"""The objects of a frame are searched by several threads at once."""

import threading
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from hlp.method.find.search import search_frame
from hlp.method.find.trace import STEPS, ObjectTrace
from hlp.records import Hypotheses, Region
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
