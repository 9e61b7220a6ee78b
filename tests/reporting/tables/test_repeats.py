import numpy as np
import pytest

from hlp.reporting.tables.repeats import mean_and_spread


def test_mean_and_standard_deviation_of_a_sample() -> None:
    shares = np.random.default_rng(2).random((4, 3))
    means, spreads = mean_and_spread(shares.tolist())
    assert [float(each) for each in means] == pytest.approx(shares.mean(axis=0), abs=6e-4)
    assert [float(each) for each in spreads] == pytest.approx(shares.std(axis=0, ddof=1), abs=6e-5)


def test_what_one_repeat_does_not_know_is_left_empty() -> None:
    assert mean_and_spread([[0.25, None], [0.75, 0.5]]) == (["0.500", ""], ["0.3536", ""])
