"""Several parts without colours help to find each other: as neighbours, and by their colour."""

from dataclasses import replace

import numpy as np
import pytest

from hlp.method.find import attempts as attempts_module
from hlp.method.find.attempts import Attempts
from hlp.records import Hypotheses
from hlp.refinement.appearance import BEST_OF_MANY
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.refiner import Refinement
from packed_boxes import PAIR, PAIR_WHOLE, PLACES, POSES, RED, WHITE, box, frame


@pytest.fixture(scope="module")
def verifier():
    return box()


class Scores:
    """An estimator that keeps coarse poses as they are and chooses the first of each search."""

    def __init__(self, verifier, scores, templates=True):
        self._verifier, self._scores, self._templates = verifier, scores, templates
        self.asked, self.appearances, self.settled, self.turned, self.fits = [], {}, {}, {}, {}

    def has_templates(self, _):
        return self._templates

    def verifier(self, _):
        return self._verifier

    def set_appearance(self, _, pose, appearance):
        self.appearances[pose.tobytes()] = appearance

    def set_settled(self, _, pose, appearance):
        self.settled[pose.tobytes()] = appearance

    def score_alone(self, _, pose):
        return self.score(_, pose)

    def measure(self, _, pose):
        return self.fits.get(pose.tobytes(), PoseFit(0.0, 0.0, 0.0, 1.0, 1.0))

    def score(self, _, pose):
        nearest = np.linalg.norm(PLACES - pose[:3, 3], axis=1)
        score = self._scores[int(nearest.argmin())] if nearest.min() < 0.01 else 0.0
        logit = np.log(max(score, 1e-9) / (1.0 - score))
        logit += self.appearances.get(pose.tobytes(), 0.0)
        return float(1.0 / (1.0 + np.exp(-logit)))

    def refine(self, _, __, coarse, missing, rest, min_score, candidates):
        self.asked.append((missing, min_score))
        return refined(*coarse.poses_cam_obj)

    def turn_over(self, _, __, pose):
        return self.turned.get(pose.tobytes())


def refined(*poses):
    if not poses:
        return None
    found, starts = [Refinement(pose, 1) for pose in poses], np.stack(poses)
    return RefinedHypotheses(found, np.zeros(len(poses)), np.arange(len(poses)), starts, (0,))


def attempts(estimator, context, instances, *searches, min_score=None):
    """Attempts at so many instances, and what searches have found already."""
    context.estimator = context.fits = estimator
    tried = Attempts(context, 1, instances, None, min_score)
    for found in searches:
        tried.add(found)
    return tried


def found_places(tried):
    poses = [] if (merged := tried.merged()) is None else merged.chosen_poses
    return [int(np.linalg.norm(PLACES - pose[:3, 3], axis=1).argmin()) for pose in poses]


def test_one_after_another_packed_neighbours_are_found(verifier):
    estimator = Scores(verifier, [0.9, 0.6, 0.7, 0.0])
    tried = attempts(estimator, frame(verifier, WHITE, WHITE, WHITE), 3, refined(POSES[0]))
    tried.search_neighbours()
    assert found_places(tried) == [0, 2, 1]
    # beside the first one, then beside the second
    assert estimator.asked == [(2, None), (1, None)]


@pytest.mark.parametrize(
    ("scores", "templates", "instances"),
    [([0.05, 0.6, 0.0, 0.0], True, 3), ([0.9, 0.6, 0.0, 0.0], False, 3), ([0.9] * 4, True, 1)],
)
def test_nothing_is_looked_for_beside_what_is_unlikely_coloured_or_all(
    verifier, scores, templates, instances
):
    estimator = Scores(verifier, scores, templates)
    tried = attempts(estimator, frame(verifier, WHITE, WHITE), instances, refined(POSES[0]))
    tried.search_neighbours()
    assert estimator.asked == [] and found_places(tried) == [0]


def test_where_the_number_is_not_known_some_more_are_tried_whatever_the_first_scores(verifier):
    context = frame(verifier, WHITE, WHITE)
    for templates, asked in ((True, (3, None)), (False, (20, 0.5))):
        estimator = Scores(verifier, [0.0] * 4, templates)
        tried = attempts(estimator, context, 20, min_score=0.5)
        tried.search_further(lambda *_: Hypotheses(POSES[:2], np.ones(2)), [])
        assert estimator.asked == [asked]


@pytest.mark.parametrize(
    ("scores", "templates", "gives_up", "found"),
    [
        ([0.95, 0.05, 0.03, 0.0], True, False, [0, 2]),
        ([0.95, 0.05, 0.03, 0.0], True, True, [0, 1]),
        ([0.95, 0.2, 0.1, 0.0], False, False, [0, 1]),
    ],
)
def test_of_unlikely_ones_those_in_the_colour_of_the_sure_go_first(
    verifier, scores, templates, gives_up, found
):
    """One that no search chose, too, unless it was given up; not of coloured objects."""
    context, unlikely = frame(verifier, WHITE, RED, WHITE), refined(POSES[1], POSES[2])
    unlikely.refined[1] = replace(unlikely.refined[1], given_up=gives_up)
    estimator = Scores(verifier, scores, templates)
    tried = attempts(estimator, context, 2, refined(POSES[0]), unlikely)
    assert found_places(tried) == found


@pytest.mark.parametrize(("templates", "found"), [(True, [2]), (False, [0])])
def test_of_a_single_part_the_likeliest_pose_is_the_answer(verifier, templates, found):
    """Whichever the search chose, by cost, and how narrow it is; if coloured, the chosen one."""
    context = frame(verifier, WHITE, WHITE, WHITE)
    estimator = Scores(verifier, [0.02, 0.0, 0.01, 0.0], templates)
    estimator.fits[POSES[2].tobytes()] = PoseFit(0.0, 0.0, 0.0, 1.0, 1.0, projected_share=0.6)
    assert found_places(attempts(estimator, context, 1, refined(POSES[0], POSES[2]))) == found


@pytest.mark.parametrize(("sure", "score", "instances"), [(0.9, 0.8, 1), (0.95, 0.3, 2)])
def test_one_beside_a_sure_one_is_likelier_than_elsewhere(verifier, sure, score, instances):
    """Not of a single part: of poses side by side, one at most is right."""
    context, told = frame(verifier, WHITE, WHITE, WHITE), []
    for other in (1, 2):  # touches the first, or is as far off again
        estimator = Scores(verifier, [sure, score, score, 0.0])
        tried = attempts(estimator, context, instances, refined(POSES[0], POSES[other]))
        assert found_places(tried) == [0, other][:instances]
        told.append(estimator.appearances[POSES[other].tobytes()])
    assert abs(told[0] - told[1]) < 0.1 if instances == 1 else told[0] > told[1] + 1.0


@pytest.mark.parametrize("color", [WHITE, RED])
def test_in_the_end_the_look_tells_less_of_answers_that_it_chose(verifier, color):
    """Neighbours tell as much as before; of an unknown number the look, too, and a worse fit."""
    told = {}
    for other in (1, 2):
        context = frame(verifier, WHITE, color, color)
        estimator = Scores(verifier, [0.95, 0.4, 0.4, 0.0])
        tried = attempts(estimator, context, 2, refined(POSES[0], POSES[other]))
        tried.poses(0.0)
        before = estimator.appearances[POSES[other].tobytes()]
        tried.merged()
        assert estimator.appearances[POSES[other].tobytes()] == before  # objects compete by it
        told[other] = before, estimator.settled[POSES[other].tobytes()]
    (beside, beside_later), (alone, alone_later) = told[1], told[2]
    assert alone_later == pytest.approx(0.2 + 0.3 * (alone - BEST_OF_MANY))
    assert beside_later - alone_later == pytest.approx(beside - alone, abs=0.3)
    tried = attempts(estimator, context, 2, refined(POSES[0], POSES[2]), min_score=0.3)
    tried.merged()
    assert estimator.settled == {key: estimator.appearances[key] for key in estimator.settled}
    estimator.fits[POSES[2].tobytes()] = PoseFit(0.15, 0.0, 0.0, 1.0, 1.0)
    tried.merged()
    fallen = [estimator.appearances[key] - told for key, told in estimator.settled.items()]
    assert fallen == pytest.approx([0.0, 30.0 * (0.15 - 0.03)])


@pytest.mark.parametrize(
    ("first", "min_score", "found"),
    [
        (0.4, None, [0, 1]),
        (0.4, 0.3, [0]),  # where their number is not known, chosen ones alone …
        (0.6, 0.3, [0, 1]),  # … unless one of them is probably right
    ],
)
def test_what_a_search_chose_and_is_likely_goes_before_what_it_did_not_choose(
    verifier, first, min_score, found
):
    context, pair = frame(verifier, WHITE, WHITE, WHITE), refined(POSES[0], POSES[1])
    estimator = Scores(verifier, [first, 0.9, 0.0, 0.0])
    assert found_places(attempts(estimator, context, 2, pair, min_score=min_score)) == found


@pytest.mark.parametrize(("min_score", "right"), [(None, True), (0.5, False)])
def test_beside_a_sure_one_another_takes_the_place_of_a_less_likely_one(verifier, min_score, right):
    context = frame(verifier, WHITE, WHITE)
    between = POSES[1].copy()
    between[0, 3] += 0.035  # on most pixels of the second box
    estimator = Scores(verifier, [0.95, 0.9, 0.0, 0.0])
    by_place = estimator.score
    estimator.score = lambda _, pose: 0.6 if pose is between else by_place(_, pose)
    estimator.refine = lambda *given: refined(*given[2].poses_cam_obj)
    tried = attempts(estimator, context, 2, refined(POSES[0], between), min_score=min_score)
    tried.search_neighbours()
    assert len(tried.poses(0.0)) == 2
    tried.search_instead()
    places = [pose[0, 3] for pose in tried.poses(0.0)]
    assert any(np.isclose(place, PLACES[1, 0]) for place in places) == right


@pytest.mark.parametrize(("score", "found"), [(0.9, 1), (0.05, 0)])
def test_likely_answers_are_turned_over_in_the_end(verifier, score, found):
    estimator = Scores(verifier, [score, score, 0.0, 0.0])
    estimator.turned[POSES[0].tobytes()] = refined(POSES[1])
    tried = attempts(estimator, frame(verifier, WHITE, WHITE), 1, refined(POSES[0]))
    tried.search_instead()
    assert found_places(tried) == [found]


class Whole(Scores):
    """What looks like one lying box, and is two standing ones, is likely; those alone are not.

    Refining is choosing by cost.
    """

    def __init__(self, verifier, observation):
        super().__init__(verifier, [])
        self._observation = observation

    def refine(self, _, __, coarse, missing, rest, min_score=None, candidates=None):
        costs = self._verifier.costs(self._observation, coarse.poses_cam_obj)
        return refined(*coarse.poses_cam_obj[np.argsort(costs)])

    def score(self, _, pose):
        is_pair = np.abs(PAIR[:, :3, 3] - pose[:3, 3]).max(axis=1).min() < 0.002
        logit = np.log(0.1 / 0.9) if is_pair else np.log(0.8 / 0.2)
        logit += self.appearances.get(pose.tobytes(), BEST_OF_MANY) - BEST_OF_MANY
        return float(1.0 / (1.0 + np.exp(-logit)))


@pytest.mark.parametrize("neighbours", [True, False])
@pytest.mark.parametrize(("second", "parts"), [((150, 150, 150), 2), (WHITE, 1)])
def test_two_parts_taken_for_one_are_as_likely_as_it_was(second, parts, neighbours):
    verifier = box((0.04, 0.1, 0.08))
    context = frame(verifier, WHITE, second, poses=PAIR)
    tried = attempts(Whole(verifier, context.observation), context, 2, refined(PAIR_WHOLE))
    if neighbours:
        tried.search_neighbours()
    tried.search_instead()  # it may bring another such answer forward
    found, places = tried.poses(0.5), PAIR if parts == 2 else PAIR_WHOLE[None]
    np.testing.assert_allclose(sorted(pose[0, 3] for pose in found), places[:, 0, 3], atol=1e-6)


def test_parts_that_do_not_fit_at_all_are_one():
    """The edge between them may be print."""
    verifier = box((0.04, 0.1, 0.08))
    context = frame(verifier, WHITE, (150, 150, 150), poses=PAIR)
    estimator = Whole(verifier, context.observation)
    fitting = estimator.score
    estimator.score = lambda _, pose: 0.03 if fitting(_, pose) < 0.5 else fitting(_, pose)
    tried = attempts(estimator, context, 2, refined(PAIR_WHOLE))
    tried.search_neighbours()
    (found,) = tried.poses(0.5)
    np.testing.assert_allclose(found, PAIR_WHOLE)


def test_parts_of_what_was_divided_are_not_divided(monkeypatch):
    verifier = box((0.04, 0.1, 0.08))
    context = frame(verifier, WHITE, (150, 150, 150), poses=PAIR)
    tried = attempts(Whole(verifier, context.observation), context, 2, refined(PAIR_WHOLE))
    looked, within = [], attempts_module.poses_within
    monkeypatch.setattr(
        attempts_module, "poses_within", lambda *given: looked.append(given[2]) or within(*given)
    )
    tried.search_instead()
    first, second = sorted(tried.merged().chosen_poses, key=lambda pose: pose[0, 3])
    np.testing.assert_allclose([first[0, 3], second[0, 3]], PAIR[:, 0, 3], atol=1e-6)
    assert len(looked) == 1
