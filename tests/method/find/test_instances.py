"""Which poses are instances: of one object, then of objects that claim the same pixels."""

from types import SimpleNamespace

import numpy as np
import pytest

from hlp.method.find import attempts
from hlp.method.find.instances import find_instances, resolve_conflicts
from hlp.method.find.trace import ObjectTrace
from hlp.records import Hypotheses, Region
from hlp.refinement.choice import InstanceSearch, RefinedHypotheses
from hlp.refinement.refiner import NoneSettings, Refinement
from hlp.refinement.verification import VerificationSettings, Verifier, observe
from refinement_scene import CAMERA, disturbed

REGION = Region(5, np.zeros((0, 2)), np.zeros(0), np.zeros((4, 4), dtype=bool))
NONE = Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))


def pose(score):
    """A pose whose score stands in its translation."""
    made = np.eye(4)
    made[0, 3] = score
    return made


class Looks:
    """An estimator that finds instances with these scores in each look; None: no hypothesis.

    `taken` has the score of a pose that stands on the pixels of a better one.
    """

    def __init__(self, *looks, taken=None):
        self.looks, self.taken = [*looks], taken
        self.asked, self.candidates = [], []

    def has_templates(self, _):
        return False

    def other_regions(self, _, region, __):
        return (region for _ in range(len(self.looks)))

    def find_hypotheses(self, _, region):
        return ObjectTrace(region, hypotheses=NONE)

    def refine(self, _, __, ___, instances, rest, ____, candidates=None):
        self.asked.append((instances, rest))
        self.candidates.append(candidates)
        scores = self.looks.pop(0)
        if scores is None:
            return None
        found = [Refinement(pose(score), 1) for score in [-1.0, *scores]]  # the first is not chosen
        rows = tuple(range(1, 1 + len(scores)))
        starts = np.stack([each.pose_cam_obj for each in found])
        return RefinedHypotheses(found, np.zeros(len(found)), np.arange(len(found)), starts, rows)

    def set_appearance(self, *_):
        pass

    set_settled = set_appearance

    def score(self, _, found):
        return float(found[0, 3])

    def verifier(self, _):
        return SimpleNamespace(
            without_explained=lambda before, found: f"{before}-{found[0, 3]:g}",
            evidence=lambda *_: None,
            is_free=lambda _, poses, __: np.array([poses[0, 0, 3] != self.taken]),
        )


def search(estimator, *given, **options):
    """Scores and sources of the instances that were found."""
    context = SimpleNamespace(estimator=estimator, fits=estimator, observation="all")
    found = find_instances(context, REGION, NONE, *given, **options)
    if found is None:
        return [], []
    return [float(p[0, 3]) for p in found.chosen_poses], found.sources[[*found.instances]].tolist()


@pytest.mark.parametrize(
    ("looks", "scores", "sources", "asked"),
    [
        ([[0.8]], [0.8], [1], 1),  # what is probably right needs no fallback
        ([[0.2], [0.1], [0.9], [0.95]], [0.9], [-1], 3),  # the first right pose is taken
        ([None, [0.1], [0.9], [0.95]], [0.9], [-1], 3),
        ([[0.2], [0.4], None, [0.3]], [0.4], [-1], 4),  # or else the best wrong one
        ([[0.3], [0.1]], [0.3], [1], 2),
        ([None, None], [], [], 2),
    ],
)
def test_likely_places_are_searched_until_a_pose_is_right(looks, scores, sources, asked):
    estimator = Looks(*looks)
    assert search(estimator) == (scores, sources)
    assert estimator.asked == [(1, None)] * asked
    assert estimator.candidates == [None, 4, 4, 4][:asked]  # few at places: there are many places


def test_missing_instances_are_looked_for_where_the_others_are_not():
    estimator = Looks([0.2, 0.9, 0.1], [0.7, 0.3], [0.4])
    assert search(estimator, 3, "rest")[0] == [0.9, 0.7, 0.4]
    assert estimator.asked == [(3, "rest"), (2, "rest-0.9"), (1, "rest-0.9-0.7")]
    whole = Looks([0.9, 0.1], [0.8])
    assert search(whole, 2)[0] == [0.9, 0.8]
    assert whole.asked[1] == (1, "all-0.9")


@pytest.mark.parametrize(
    ("looks", "most", "min_score", "scores"),
    [
        ([[0.6, 0.3], [0.9]], 10, 0.5, [0.6, 0.3]),  # one is enough if their number is not known
        ([[0.6, 0.3], [0.9, 0.2]], 10, 0.7, [0.9, 0.6, 0.3, 0.2]),
        # A low min_score does not skip the fallback.
        *(([[0.4, 0.1], [0.9, 0.2]], 10, low, [0.9, 0.4, 0.2, 0.1]) for low in (0.0, 0.05, 0.3)),
        ([[0.4], [0.9]], 1, 0.05, [0.9]),
        ([[0.6, 0.4]], 10, 0.05, [0.6, 0.4]),
        ([[0.4, 0.1], [0.3]], 10, 0.3, [0.4, 0.3, 0.1]),
    ],
)
def test_where_the_number_of_instances_is_not_known(looks, most, min_score, scores):
    assert search(Looks(*looks), most, min_score=min_score)[0] == scores


class Templates(Looks):
    """The second look is one by templates."""

    matched = None

    def has_templates(self, _):
        return True

    def match_templates(self, _, __, missing, rest):
        self.matched = missing, rest
        return NONE


@pytest.mark.parametrize(
    ("looks", "most", "scores", "matched"),
    [
        ([[0.97], [0.3]], 1, [0.97], None),  # votes are sure
        ([[0.9], [0.3]], 1, [0.9], (1, None)),
        ([[0.97], [0.3], [0.8]], 10, [0.97, 0.3], (9, "all-0.97")),  # there may be more of them
        # and more, until a search finds none that is right
        ([[0.97], [0.6], [0.8], [0.3]], 9, [0.97, 0.8, 0.6, 0.3], (6, "all-0.97-0.8-0.6")),
        ([[0.97], [0.6], [0.8], [0.3]], 3, [0.97, 0.8, 0.6], (1, "all-0.97-0.6")),
    ],
)
def test_templates_are_asked_for_where_votes_are_not_sure(
    looks, most, scores, matched, monkeypatch
):
    monkeypatch.setattr(attempts.Attempts, "_judge", lambda self: self._answers)
    monkeypatch.setattr(attempts.Attempts, "_colors", SimpleNamespace(samples=None))
    monkeypatch.setattr(attempts.Chosen, "settle", lambda *_: None)
    for search_of_packed in ("search_neighbours", "_divide", "_turn_over"):
        monkeypatch.setattr(attempts.Attempts, search_of_packed, lambda *_: None)
    estimator = Templates(*looks)
    found = search(estimator, most, min_score=0.5)[0]
    assert [score for score in found if score >= 0] == scores  # -1: what no search chose
    assert estimator.matched == matched
    assert set(estimator.candidates) == {None}  # votes for parts without colours are often wrong


def test_no_instance_is_answered_twice():
    """A worse pose of what a better one explains already is no further answer."""
    estimator = Looks([0.4, 0.1], [0.9, 0.2], taken=0.4)
    assert search(estimator, 10, min_score=0.3)[0] == [0.9, 0.2, 0.1]


def test_without_the_fallback_the_first_look_is_the_only_one_and_needs_no_score(monkeypatch):
    monkeypatch.delattr(Looks, "score")
    assert search(Looks([0.2], [0.9]), fallback=False) == ([0.2], [1])


class Twins:
    """Two objects of the same shape under the ids 1 and 2; nothing is refined."""

    def __init__(self, scene, scores=None):
        self.scene, self.scores, self.asked = scene, scores, list[int]()
        settings = VerificationSettings()
        seen = observe(scene.rgb, scene.depth, CAMERA, settings)
        barren = dict.fromkeys((1, 2), "places")
        self.context = SimpleNamespace(estimator=self, fits=self, observation=seen, barren=barren)
        self._verifier = Verifier(scene.model, settings)

    def verifier(self, _):
        return self._verifier

    def has_templates(self, _):
        return self.scores is not None

    def score(self, object_id, _):
        return 1.0 if self.scores is None else self.scores[object_id]

    def refine(self, object_id, given, rest=None):
        self.asked.append(object_id)
        refiner, seen = NoneSettings().build(1), self.context.observation
        return InstanceSearch(refiner, self._verifier, seen, given, 0, rest).find()

    def resolve(self, poses):
        """What was found of objects, given their coarse poses, before and after conflicts."""
        given = {i: Hypotheses(np.stack(own), np.ones(len(own))) for i, own in poses.items()}
        found = {i: self.refine(i, own) for i, own in given.items()}
        search_again = lambda i, rest: self.refine(i, given[i], rest)  # noqa: E731
        return found, resolve_conflicts(self.context, found, search_again)


@pytest.fixture(scope="module")
def elsewhere(row):
    """Where another thing of the same shape stands."""
    return disturbed(row[1], 6.0, 6.0, seed=2)


@pytest.fixture(scope="module")
def off(row):
    """A pose near the true one, which costs more."""
    return disturbed(row[0], 4.0, 4.0, seed=1)


def test_what_stands_on_anothers_pixels_is_chosen_anew(row, off, elsewhere):
    estimator = Twins(row[0])
    found, resolved = estimator.resolve({1: [row[0].pose], 2: [off, elsewhere]})
    assert found[2].sources[found[2].instances[0]] == 0
    assert resolved[1] is found[1] and estimator.asked == [1, 2, 2]
    assert resolved[2].sources[resolved[2].instances[0]] == 1
    assert [*estimator.context.barren] == [1]  # where it was, its templates may fit again


@pytest.mark.parametrize("scores", [None, {1: 0.9, 2: 0.6}, {1: 0.6, 2: 0.9}])
def test_of_two_in_one_place_the_cheaper_stays_or_without_colours_the_more_probable(
    row, off, scores
):
    """The costs of different objects cannot be compared: that of the second is less each time."""
    found, resolved = Twins(row[0], scores).resolve({1: [off], 2: [row[0].pose]})
    winner = max(scores, key=scores.__getitem__) if scores else 2
    assert resolved[winner] is found[winner] and resolved[3 - winner] is None


def test_other_instances_of_a_loser_keep_their_claims(row, off, elsewhere):
    """The second object loses one place to the first, but takes another one from it."""
    estimator = Twins(row[0], {1: 0.9, 2: 0.8})
    less = disturbed(row[1], 3.0, 3.0, seed=3)
    estimator.score = lambda i, pose: 0.7 if pose is less else estimator.scores[i]
    found = {
        i: SimpleNamespace(instances=(0, 1), chosen_poses=poses, costs=np.zeros(2))
        for i, poses in {1: [off, less], 2: [row[0].pose, elsewhere]}.items()
    }
    searched = []
    resolve_conflicts(estimator.context, found, lambda i, _: searched.append(i))
    assert searched == [2, 1]


def test_objects_beside_each_other_keep_their_poses(row, elsewhere):
    found, resolved = Twins(row[0]).resolve({1: [row[0].pose], 2: [elsewhere]})
    assert resolved == found
    alone, same = Twins(row[0]).resolve({1: [row[0].pose]})
    assert same is alone
