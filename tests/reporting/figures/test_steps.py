"""The ladder's figure: a row an arm with its recall, on an axis that shows the differences."""

import numpy as np
import pytest

from hlp.reporting.figures.swarm_costs import Step, draw_steps


@pytest.mark.parametrize(
    ("lowest", "begin", "said"),
    [
        (0.0, 0.0, "ADD(-S) recall"),
        (0.04, 0.0, "ADD(-S) recall"),
        (0.84, 0.8, "ADD(-S) recall (axis cut: begins at 0.8)"),
        (0.8, 0.7, "ADD(-S) recall (axis cut: begins at 0.7)"),
    ],
)
def test_the_axis_begins_below_all_intervals(lowest: float, begin: float, said: str) -> None:
    steps = [
        Step("best", (0.975, (0.94, 1.0)), None),
        Step("without_joint", (0.912, (lowest, 0.96)), (-0.063, (-0.12, -0.01))),
    ]
    left, right = draw_steps(steps, "80 targets").axes
    low, high = left.get_xlim()
    assert begin - 0.03 < low < begin and 1.0 < high < 1.03
    assert left.get_xlabel() == said
    names = [label.get_text() for label in left.get_yticklabels()]
    assert names == ["best  0.975", "without_joint  0.912"]
    assert len(right.containers) == 1  # the first has nothing to be compared with


def test_the_figure_has_a_row_for_each_arm_from_top_to_bottom() -> None:
    steps = [
        Step("first", (0.2, (0.1, 0.3)), None),
        Step("second", (0.6, (0.5, 0.7)), (0.4, (0.3, 0.5))),
    ]
    left, right = draw_steps(steps, "4 targets").axes
    assert [label.get_text() for label in left.get_yticklabels()] == [
        "first  0.200",
        "second  0.600",
    ]
    bottom, top = left.get_ylim()
    assert bottom > top
    recalls, gains = (ax.containers[0].lines[0].get_xydata() for ax in (left, right))
    np.testing.assert_array_equal(recalls, [[0.2, 0], [0.6, 1]])
    np.testing.assert_array_equal(gains, [[0.4, 1]])
