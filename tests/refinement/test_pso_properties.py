"""The swarm never ends worse than it began, whatever the cost, the box and the random numbers."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from generated_values import SEEDS, numbers, poses_in_front, share_of_examples, vectors
from hlp.records import Hypotheses
from hlp.refinement.cost import CostSettings, DepthCost
from hlp.refinement.pso import PsoRefiner, PsoSettings, search
from refinement_scene import CAMERA, disturbed


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


def settings():
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


@given(settings(), poses_in_front(), vectors(-0.1, 0.1), SEEDS)
def test_the_answer_is_the_best_pose_that_was_tried(chosen, start, centroid, seed):
    cost = Rippled(seed)
    found, iterations = search(cost, start, centroid, chosen, np.random.default_rng(seed))
    lowest = cost.lowest
    np.testing.assert_allclose(cost.evaluate(found[None])[0], lowest, atol=1e-7)
    assert lowest <= cost.evaluate(start[None])[0] + 1e-9
    assert 0 <= iterations <= chosen.iterations
    rotation = found[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)


@share_of_examples(4)
@given(numbers(0.0, 30.0), numbers(0.0, 30.0), SEEDS)
def test_a_refined_pose_fits_the_depth_no_worse_than_the_coarse_one(
    scene, degrees, millimetres, seed
):
    coarse = disturbed(scene, degrees, millimetres, seed)
    few = replace(PsoSettings(), particles=6, iterations=4, cost=CostSettings())
    given_ = (scene.model, scene.seen)
    found = PsoRefiner(few).refine(*given_, Hypotheses(coarse[None], np.ones(1)), seed)[0]
    cost = DepthCost(scene.model.proxy, scene.depth, CAMERA, coarse, few.cost)
    before, after = cost.evaluate(np.stack([coarse, found.pose_cam_obj]))
    assert after <= before + 1e-6
