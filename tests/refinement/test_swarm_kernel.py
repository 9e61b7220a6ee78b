"""The compiled swarm against NumPy, one line of the textbook at a time."""

import numpy as np

from hlp.refinement.pso import update_personal_bests, update_swarm

RNG = np.random.default_rng(0)


def test_flight_is_the_textbooks() -> None:
    position, velocity, personal_best = RNG.uniform(-1, 1, (3, 25, 6))
    global_best, random = RNG.uniform(-1, 1, 6), RNG.random((2, 25, 6))
    expected = 2.8 * random[0] * (personal_best - position) + 2.8 / 2 * random[1] * (
        global_best - position
    )
    expected = 0.73 * (velocity + expected)
    before = position.copy()
    update_swarm(position, velocity, personal_best, global_best, random, (2.8, 1.4), 0.73)
    np.testing.assert_allclose(velocity, expected, rtol=1e-12)
    np.testing.assert_allclose(position, np.clip(before + expected, -1, 1), rtol=1e-12)
    assert (np.abs(position) == 1.0).any() and (np.abs(position) < 1.0).any()


def test_memory_holds_each_particles_best_and_names_the_swarms() -> None:
    position, personal_best = RNG.uniform(-1, 1, (2, 25, 6))
    cost, personal_best_cost = RNG.random((2, 25))
    better = cost < personal_best_cost
    expected = np.where(better[:, None], position, personal_best)
    lowest = np.minimum(cost, personal_best_cost)
    best = update_personal_bests(position, cost, personal_best, personal_best_cost)
    np.testing.assert_array_equal(personal_best, expected)
    np.testing.assert_array_equal(personal_best_cost, lowest)
    assert best == lowest.argmin()
    assert (
        update_personal_bests(position, np.ones(25), personal_best, np.full(25, 0.5)) == 0
    )  # the first of equals
