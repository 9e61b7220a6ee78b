import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hlp.reporting.figures.trade_off import pareto_front

# Few values, so that many points are equal in one or both.
FEW = st.integers(0, 6)


def beaten(times: np.ndarray, recalls: np.ndarray) -> np.ndarray:
    """For every point: whether any other is as good in both, and better in one. The definition."""
    as_good = (times[None] <= times[:, None]) & (recalls[None] >= recalls[:, None])
    better = (times[None] < times[:, None]) | (recalls[None] > recalls[:, None])
    return (as_good & better).any(axis=1)


@given(st.lists(st.tuples(FEW, FEW), max_size=30))
def test_the_front_is_what_no_point_beats(points: list[tuple[int, int]]) -> None:
    times, recalls = np.array(points).reshape(-1, 2).T
    front = pareto_front(times.tolist(), recalls.tolist())
    assert sorted(front) == np.flatnonzero(~beaten(times, recalls)).tolist()
    assert [(times[i], recalls[i]) for i in front] == sorted((times[i], recalls[i]) for i in front)


def test_one_point_and_none() -> None:
    assert pareto_front([3.0], [0.5]) == [0]
    assert pareto_front([], []) == []
