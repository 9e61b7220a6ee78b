"""The compiled swarm against NumPy, one line of the textbook at a time."""

import numpy as np

from hlp.refinement.swarm_kernel import fly, remember

RNG = np.random.default_rng(0)


def test_flight_is_the_textbooks() -> None:
    position, velocity, own = RNG.uniform(-1, 1, (3, 25, 6))
    leader, chance = RNG.uniform(-1, 1, 6), RNG.random((2, 25, 6))
    expected = 2.8 * chance[0] * (own - position) + 2.8 / 2 * chance[1] * (leader - position)
    expected = 0.73 * (velocity + expected)
    before = position.copy()
    fly(position, velocity, own, leader, chance, (2.8, 1.4), 0.73)
    np.testing.assert_allclose(velocity, expected, rtol=1e-12)
    np.testing.assert_allclose(position, np.clip(before + expected, -1, 1), rtol=1e-12)
    assert (np.abs(position) == 1.0).any() and (np.abs(position) < 1.0).any()


def test_memory_holds_each_particles_best_and_names_the_swarms() -> None:
    position, own = RNG.uniform(-1, 1, (2, 25, 6))
    cost, own_cost = RNG.random((2, 25))
    better = cost < own_cost
    expected = np.where(better[:, None], position, own)
    lowest = np.minimum(cost, own_cost)
    best = remember(position, cost, own, own_cost)
    np.testing.assert_array_equal(own, expected)
    np.testing.assert_array_equal(own_cost, lowest)
    assert best == lowest.argmin()
    assert remember(position, np.ones(25), own, np.full(25, 0.5)) == 0  # the first of equals
