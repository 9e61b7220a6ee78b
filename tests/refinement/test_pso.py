"""The swarm on costs whose minimum is known, and its moves against Eq. R_x R_y R_z."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from generated_values import SEEDS, numbers, poses_in_front, vectors
from hlp.geometry import rigid, rotation_distance
from hlp.records import Hypotheses
from hlp.refinement.pso import DescentSettings, PsoRefiner, PsoSettings, descend, search
from hlp.refinement.refiner import Refinement
from hlp.refinement.swarm_kernel import apply_offsets, update_swarm
from refinement_scene import colorless, disturbed, error, posed

CENTROID = np.array([0.02, -0.01, 0.03])
RNG = np.random.default_rng(0)


class Bowl:
    """Distance to a known pose: 1 for each radian and for each 0.1 m of the centroid."""

    def __init__(self, goal):
        self.goal = goal
        self.costs = []

    def evaluate(self, poses):
        middle = poses[:, :3, :3] @ CENTROID + poses[:, :3, 3]
        goal = self.goal[:3, :3] @ CENTROID + self.goal[:3, 3]
        angle = rotation_distance(poses[:, :3, :3], self.goal[:3, :3])
        costs = angle**2 + (np.linalg.norm(middle - goal, axis=1) / 0.1) ** 2
        self.costs.append(costs.copy())  # the search changes what it is given
        return costs


@pytest.fixture
def settings(cost_settings, verification):
    """Of swarms alone."""
    of = {"cost": cost_settings, "verification": verification, "descent": None}
    return PsoSettings(**of, iterations=60, patience=10)


@pytest.fixture
def descending(settings):
    """Six steps by parabolas, then a swarm."""
    return replace(settings, descent=PsoSettings().descent)


def start():
    return rigid(np.eye(3), np.array([0.0, 0.0, 0.8]))


def test_offsets_rotate_about_the_centroid_in_the_papers_order():
    a, b, c = steps = np.array([0.3, -0.5, 0.7])
    shift = np.array([0.01, 0.02, -0.03])
    x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    first = rigid(z @ x, np.array([0.1, 0.2, 0.9]))
    result = apply_offsets(first, np.concatenate([steps, shift])[None], CENTROID)[0]
    np.testing.assert_allclose(result[:3, :3], x @ y @ z @ first[:3, :3], atol=1e-12)
    before = first[:3, :3] @ CENTROID + first[:3, 3]
    np.testing.assert_allclose(result[:3, :3] @ CENTROID + result[:3, 3], before + shift)


def test_swarm_reaches_goals_outside_its_box_only_when_the_box_follows(settings):
    goal = apply_offsets(start(), np.array([[0.5, -0.3, 0.2, 0.03, -0.02, 0.01]]), CENTROID)[0]
    follows, _ = search(Bowl(goal), start(), CENTROID, settings, np.random.default_rng(0))
    fixed = replace(settings, recentre=False)
    stays, _ = search(Bowl(goal), start(), CENTROID, fixed, np.random.default_rng(0))
    assert Bowl(goal).evaluate(follows[None])[0] < 1e-3
    assert Bowl(goal).evaluate(stays[None])[0] > 0.1
    assert rotation_distance(stays[:3, :3], np.eye(3)) < np.deg2rad(10.0) * 3**0.5 + 1e-9


def test_a_pose_that_cannot_be_bettered_is_kept(settings):
    bowl = Bowl(start())
    found, iterations = search(bowl, start(), CENTROID, settings, np.random.default_rng(0))
    np.testing.assert_allclose(found, start(), atol=1e-12)
    assert iterations == settings.patience
    assert len(bowl.costs) == settings.patience + 1
    few = replace(settings, iterations=4)
    assert search(Bowl(start()), start(), CENTROID, few, np.random.default_rng(0))[1] == 4


def test_a_hopeless_pose_has_no_swarm_and_others_are_not_affected(scene, settings, descending):
    """It is asked about the pose after three parabolas; swarms begin after six."""
    coarse = Hypotheses(np.stack([disturbed(scene, 15, 10, k) for k in range(3)]), np.ones(3))
    asked = []

    def the_second_is(pose):
        asked.append(pose)
        return len(asked) == 2

    given = scene.model, scene.seen, coarse, 0
    found = PsoRefiner(descending).refine(*given, is_hopeless=the_second_is)
    assert [one.given_up for one in found] == [False, True, False]
    assert found[1].iterations == 3 and found[0].iterations > 6
    np.testing.assert_array_equal(found[1].pose_cam_obj, asked[1])
    soon = PsoRefiner(descending).soon().refine(*given)
    middle = Hypotheses(np.stack([each.pose_cam_obj for each in soon]), np.ones(3))
    swarms = PsoRefiner(settings).refine(scene.model, scene.seen, middle, 0)
    for place in (0, 2):
        np.testing.assert_array_equal(found[place].pose_cam_obj, swarms[place].pose_cam_obj)


def test_a_first_look_comes_much_nearer_without_a_swarm(scene, settings, descending):
    coarse = Hypotheses(np.stack([disturbed(scene, 15, 10, k) for k in range(6)]), np.ones(6))
    given = scene.model, scene.seen, coarse
    found = PsoRefiner(descending).soon().refine(*given, seed=0)
    assert {each.iterations for each in found} == {6}
    again = PsoRefiner(descending).soon().refine(*given, seed=1)
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.pose_cam_obj, other.pose_cam_obj)
    poses = coarse.poses_cam_obj, [each.pose_cam_obj for each in found]
    before, after = (np.mean([error(scene, pose) for pose in some]) for some in poses)
    assert after < 0.3 * before
    assert (swarms := PsoRefiner(settings)).soon() is swarms


@pytest.mark.parametrize("colored", [False, True])
def test_without_colours_a_hypothesis_that_soon_costs_much_is_given_up(scene, descending, colored):
    """The bad one is in the air before the object."""
    model = scene.model if colored else colorless(scene.model)
    far = scene.pose.copy()
    far[2, 3] *= 0.7
    coarse = Hypotheses(np.stack([disturbed(scene, 5, 5, 1), far]), np.ones(2))
    good, bad = PsoRefiner(descending).refine(model, scene.seen, coarse, 0)
    assert not good.given_up and bad.given_up != colored
    assert bad.iterations == 3 or colored


def test_hypotheses_after_the_budget_stay_as_they_are(scene, settings):
    """`spent` belongs to the budget; without a budget it changes nothing."""
    coarse = Hypotheses(np.stack([disturbed(scene, 20, 20, 1)] * 2), np.ones(2))
    given = (scene.model, scene.seen, coarse, 0)
    generous = PsoRefiner(replace(settings, budget_ms=60_000.0, iterations=2))
    for each in generous.refine(*given, spent=61.0):
        np.testing.assert_array_equal(each.pose_cam_obj, coarse.poses_cam_obj[0])
        assert each.iterations == 0
    assert [each.iterations for each in generous.refine(*given, spent=1.0)] == [2, 2]
    unlimited = PsoRefiner(replace(settings, iterations=2))
    assert [each.iterations for each in unlimited.refine(*given, spent=61.0)] == [2, 2]


def test_hypotheses_have_their_own_streams(scene, settings):
    """What becomes of one hypothesis does not depend on those before it."""
    first = disturbed(scene, 20, 10, 1)
    second = posed(scene.model, np.eye(3), np.array([0.0, 0.0, 0.6]))
    pairs = [Hypotheses(np.stack([before, first]), np.ones(2)) for before in (second, first)]
    refine = PsoRefiner(replace(settings, iterations=3)).refine
    found = [refine(scene.model, scene.seen, pair, 7)[1] for pair in pairs]
    np.testing.assert_array_equal(found[0].pose_cam_obj, found[1].pose_cam_obj)


def test_a_second_search_makes_the_answer_more_exact(scene, settings):
    refiner = PsoRefiner(settings)
    answers = [Refinement(disturbed(scene, 2, 2, seed), 5) for seed in range(4)]
    found = [refiner.second_search(scene.model, scene.seen, answer) for answer in answers]
    assert all(each.iterations > 5 for each in found)
    before, after = (np.mean([error(scene, e.pose_cam_obj) for e in s]) for s in (answers, found))
    assert after < 0.6 * before


def test_no_second_search_where_none_is_set_or_no_time_is_left(scene, settings):
    answer = Refinement(disturbed(scene, 2, 2, 0), 5)
    given = (scene.model, scene.seen, answer)
    assert PsoRefiner(replace(settings, second_search=None)).second_search(*given) is answer
    late = PsoRefiner(replace(settings, budget_ms=50.0))
    assert late.second_search(*given, spent=0.06) is answer
    assert late.second_search(*given, spent=0.0) is not answer


def test_it_stops_when_no_particle_betters_its_own_best(settings):
    """The text's "until no particle improves", against counting iterations here."""
    goal = apply_offsets(start(), np.array([[0.1, -0.05, 0.02, 0.004, 0.0, 0.002]]), CENTROID)[0]
    few = replace(settings, particles=25, patience=1, recentre=False, iterations=500)
    spent = {}
    for gain in ("swarm", "particle"):
        cost = Bowl(goal)
        chosen = replace(few, gain=gain)
        _, spent[gain] = search(cost, start(), CENTROID, chosen, np.random.default_rng(0))
        own = np.minimum.accumulate(np.stack(cost.costs), axis=0)
        steps = np.diff(own.min(axis=1, keepdims=True) if gain == "swarm" else own, axis=0)
        gained = (steps < 0).any(axis=1)
        assert gained[:-1].all() and not gained[-1]
    assert spent["particle"] > spent["swarm"]


def test_flight_is_the_textbooks():
    position, velocity, personal_best = RNG.uniform(-1, 1, (3, 25, 6))
    global_best, random = RNG.uniform(-1, 1, 6), RNG.random((2, 25, 6))
    pulls = 2.8 * random[0] * (personal_best - position), 1.4 * random[1] * (global_best - position)
    expected = 0.73 * (velocity + sum(pulls))
    before = position.copy()
    update_swarm(position, velocity, personal_best, global_best, random, (2.8, 1.4), 0.73)
    np.testing.assert_allclose(velocity, expected, rtol=1e-12)
    np.testing.assert_allclose(position, np.clip(before + expected, -1, 1), rtol=1e-12)
    assert (np.abs(position) == 1.0).any() and (np.abs(position) < 1.0).any()


class Rippled:
    """A cost with many minima: waves over the twelve numbers of a pose."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.waves = rng.normal(scale=20.0, size=(12, 5))
        self.lowest = np.inf

    def evaluate(self, poses):
        costs = np.sin(poses[:, :3].reshape(-1, 12) @ self.waves).sum(axis=1)
        self.lowest = min(self.lowest, float(costs.min()))
        return costs


def few_particles():
    return st.builds(
        PsoSettings,
        particles=st.integers(1, 12),
        theta_deg=numbers(0.0, 40.0),
        tau_mm=numbers(0.0, 60.0),
        phi_1=numbers(2.1, 4.0),
        phi_2=numbers(2.0, 4.0),
        iterations=st.integers(0, 12),
        patience=st.integers(0, 6),
        recentre=st.booleans(),
        gain=st.sampled_from(["swarm", "particle"]),
    )


@given(few_particles(), poses_in_front(), vectors(-0.1, 0.1), SEEDS)
def test_the_answer_is_the_best_pose_that_was_tried(chosen, start, centroid, seed):
    cost = Rippled(seed)
    found, iterations = search(cost, start, centroid, chosen, np.random.default_rng(seed))
    lowest = cost.lowest
    np.testing.assert_allclose(cost.evaluate(found[None])[0], lowest, atol=1e-7)
    assert lowest <= cost.evaluate(start[None])[0] + 1e-9
    assert 0 <= iterations <= chosen.iterations
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-9)


def test_parabolas_lead_to_the_bottom_of_a_bowl():
    offset = np.array([[0.06, -0.04, 0.05, 0.004, -0.003, 0.004]])
    goal = apply_offsets(start(), offset, CENTROID)[0]
    found, iterations = descend(Bowl(goal), start(), CENTROID, DescentSettings())
    assert 1 < iterations <= 12
    assert Bowl(goal).evaluate(found[None])[0] < 1e-3 * Bowl(goal).evaluate(start()[None])[0]
    few = DescentSettings(iterations=2)
    assert descend(Bowl(goal), start(), CENTROID, few)[1] == 2
    none = DescentSettings(patience=0)
    assert descend(Bowl(goal), start(), CENTROID, none) == (pytest.approx(start()), 0)


@given(poses_in_front(), vectors(-0.1, 0.1), SEEDS, st.integers(0, 6))
def test_a_descent_ends_at_the_best_pose_that_it_has_tried(start, centroid, seed, patience):
    cost = Rippled(seed)
    found, _ = descend(cost, start, centroid, DescentSettings(6.0, 100.0, patience))
    lowest = cost.lowest
    np.testing.assert_allclose(cost.evaluate(found[None])[0], lowest, atol=1e-7)
    assert lowest <= cost.evaluate(start[None])[0] + 1e-9
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-9)
