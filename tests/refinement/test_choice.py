"""Which hypotheses are refined, in what order, which is chosen, and the search about that."""

from dataclasses import replace

import numpy as np
import pytest

from hlp.records import Hypotheses
from hlp.refinement.choice import InstanceSearch
from hlp.refinement.refiner import Refinement
from hlp.refinement.score_model import ScoreModel
from hlp.refinement.verification import Verifier, observe
from refinement_scene import CAMERA, colorless, disturbed, error, search_of


class Recorder:
    """Leaves poses where they are and records its calls."""

    def __init__(self):
        self.asked, self.spent, self.searched_again = [], [], []

    def refine(self, model, observation, hypotheses, seed, spent=0.0, is_hopeless=None):
        self.asked.append(hypotheses.poses_cam_obj)
        self.spent.append(spent)
        poses, judge = hypotheses.poses_cam_obj, is_hopeless or (lambda _: False)
        return [Refinement(pose, 1, judge(pose)) for pose in poses]

    def second_search(self, model, observation, answer, spent=0.0):
        self.searched_again.append(answer.pose_cam_obj)
        self.spent.append(spent)
        return Refinement(answer.pose_cam_obj, answer.iterations + 1)


def choose(*args, **options):
    return search_of(*args, **options).find()


def costs_of(scene, verification, poses):
    seen = observe(scene.rgb, scene.depth, CAMERA, verification)
    return Verifier(scene.model, verification).costs(seen, poses)


@pytest.fixture
def poses(scene):
    """From bad to good: the last is right."""
    return np.stack([disturbed(scene, 12 * k, 6 * k, seed=k) for k in range(6)][::-1])


def test_the_best_is_found_refined_first_and_searched_again(scene, verification, poses):
    refiner = Recorder()
    result = choose(scene, verification, refiner, poses, max_improvement=1.0)
    assert len(refiner.asked) == 3 and len(result.refined) == len(result.costs) == 6
    np.testing.assert_array_equal(refiner.asked[0][0], poses[-1])
    assert result.sources[result.instances[0]] == 5 and sorted(result.sources) == list(range(6))
    for source, refined in zip(result.sources, result.refined, strict=True):
        np.testing.assert_array_equal(refined.pose_cam_obj, poses[source])
    np.testing.assert_array_equal(refiner.searched_again, poses[-1:])
    assert result.refined[result.instances[0]].iterations == 2
    assert error(scene, result.refined[result.instances[0]].pose_cam_obj) < 1e-9
    assert 0 < refiner.spent[0] < refiner.spent[1] < refiner.spent[-1]


def test_no_more_are_refined_than_asked_for(scene, verification, poses):
    result = choose(scene, verification, Recorder(), poses, candidates=3, max_improvement=1.0)
    costs = costs_of(scene, verification, poses)
    np.testing.assert_array_equal(result.sources, np.argsort(costs)[:3])
    fewer = choose(scene, verification, Recorder(), poses, 3, max_improvement=1.0, most=2)
    np.testing.assert_array_equal(fewer.sources, np.argsort(costs)[:2])


def test_what_scores_too_little_early_on_is_given_up_and_not_searched_again(
    scene, verification, poses
):
    """Less than a thirtieth of the least score of an answer, by shape alone."""
    for bias, given_up in ((-4.3, True), (-4.1, False)):
        refiner = Recorder()
        early_score = ScoreModel(bias, 0.0, 0.0)
        result = choose(scene, verification, refiner, poses, early_score=early_score)
        assert [one.given_up for one in result.refined] == [given_up] * len(result.refined)
        assert len(refiner.searched_again) == (not given_up)


def test_fewer_are_refined_of_an_object_that_may_be_absent(scene, verification, poses):
    many, surely = np.concatenate([poses] * 3), ScoreModel(9.0, 0.0, 0.0)
    given = scene, verification, Recorder(), many, 18, 1.0
    assert [len(choose(*given, early_score=s).refined) for s in (None, surely)] == [18, 8]


def test_no_others_are_refined_beside_a_sure_one(scene, verification, poses, monkeypatch):
    def count(seen, score=0.91):
        rules = verification, Recorder(), poses, 6, 1.0
        return len(choose(seen, *rules, score=lambda _: score).refined)

    assert (count(scene, 0.89), count(scene)) == (6, 2)
    assert count(replace(scene, model=colorless(scene.model))) == 6
    monkeypatch.setattr(Verifier, "turns", np.stack([np.eye(4)] * 2))  # turns that look alike
    assert count(scene) == 6


def test_hypotheses_that_cost_far_more_are_not_refined(scene, verification, poses):
    costs = np.sort(costs_of(scene, verification, poses))
    apart = costs[2] - costs[0]
    assert apart > 0.02
    few = choose(scene, verification, Recorder(), poses, max_improvement=apart * 0.9)
    more = choose(scene, verification, Recorder(), poses, max_improvement=apart * 1.1)
    assert len(few.refined) == 2 < len(more.refined)


class SecondSearch(Recorder):
    """Finds a given pose in every second search."""

    def __init__(self, found):
        super().__init__()
        self.result = found

    def second_search(self, model, observation, answer, spent=0.0):
        return Refinement(self.result, answer.iterations + 1)


def test_the_cost_is_that_of_the_second_search(scene, verification, poses):
    """Among the other refined poses, whose costs stay as they are."""
    coarse = poses[:4]
    result = choose(scene, verification, SecondSearch(scene.pose), coarse, max_improvement=1.0)
    plain = choose(scene, verification, Recorder(), coarse, max_improvement=1.0)
    np.testing.assert_array_equal(result.refined[result.instances[0]].pose_cam_obj, scene.pose)
    together = np.stack([item.pose_cam_obj for item in result.refined])
    observation = observe(scene.rgb, scene.depth, CAMERA, verification)
    verifier = Verifier(scene.model, verification)
    evidence = verifier.evidence(observation, together)
    expected = verifier.competing_costs(evidence, together, np.ones(4))[result.instances[0]]
    assert result.costs[result.instances[0]] == expected < plain.costs[plain.instances[0]]
    others = np.arange(4) != result.instances[0]
    np.testing.assert_array_equal(result.costs[others], plain.costs[others])


def test_a_second_search_that_makes_the_pose_worse_is_undone(scene, verification, poses):
    result = choose(scene, verification, SecondSearch(poses[0]), poses)
    plain = choose(scene, verification, Recorder(), poses)
    np.testing.assert_array_equal(result.refined[result.instances[0]].pose_cam_obj, poses[-1])
    np.testing.assert_array_equal(result.costs, plain.costs)


def test_hypotheses_behind_the_camera_or_not_finite_are_dropped(scene, verification, poses):
    """Where no other is left there is no result."""
    bad = poses.copy()
    bad[0, 0, 0] = np.nan
    bad[2, 2, 3] *= -1.0
    bad[4, 1, 3] = np.inf
    result = choose(scene, verification, Recorder(), bad, max_improvement=1.0)
    alone = choose(scene, verification, Recorder(), bad[[1, 3, 5]], max_improvement=1.0)
    np.testing.assert_array_equal(result.sources, np.array([1, 3, 5])[alone.sources])
    np.testing.assert_array_equal(result.costs, alone.costs)
    assert result.sources[result.instances[0]] == 5
    refiner = Recorder()
    assert search_of(scene, verification, refiner, bad[[0, 2, 4]]).find() is None
    assert refiner.asked == [] and refiner.searched_again == []


def test_a_coarse_pose_is_refined_once_in_an_image(scene, verification):
    """Another search of the image takes the pose, in whatever order it comes."""
    poses = np.stack([disturbed(scene, 4.0 * k, 2.0 * k, seed=k) for k in range(1, 5)])
    seen, verifier = scene.seen, Verifier(scene.model, verification)
    first, again, known = Recorder(), Recorder(), {}

    def look(refiner, some):
        given = refiner, verifier, seen, Hypotheses(some, np.ones(len(some))), len(known)
        return InstanceSearch(*given, known=known).find()

    before = look(first, poses[:3])
    after = look(again, poses[::-1])
    np.testing.assert_array_equal(np.concatenate(again.asked), poses[3:])
    assert len(after.refined) == 4 == len(known) and len(before.refined) == 3
    for found in (before, after):
        np.testing.assert_array_equal([one.pose_cam_obj for one in found.refined], found.starts)
