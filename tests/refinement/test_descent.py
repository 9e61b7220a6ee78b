"""Parabolas on costs whose minimum is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from generated_values import SEEDS, poses_in_front, vectors
from hlp.refinement.descent import DescentSettings, descend
from hlp.refinement.swarm_kernel import apply_offsets
from pose_costs import CENTROID, Bowl, Rippled, start


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
