from typing import Any

import numpy as np
import pytest

from hlp.records import TargetScore
from hlp.runs.page_material import MISSED, RIGHT, choose_targets, keep_material


def score(frame: int, object_id: int, right: bool) -> TargetScore:
    return TargetScore(1, frame, object_id, True, 1.0, 0.0, 0.0, 0.0, 1.0, right, right, right)


def test_missed_targets_and_some_right_ones_are_chosen_with_their_places() -> None:
    scores = [score(3, 6, True), score(3, 2, False), score(3, 6, False), score(4, 6, True)]
    assert choose_targets(scores) == [
        ((1, 3, 2, 0), 1),
        ((1, 3, 6, 0), 0),
        ((1, 3, 6, 1), 2),
        ((1, 4, 6, 0), 0),
    ]


def test_too_many_are_thinned_out_evenly() -> None:
    many = [score(frame, 1, frame % 2 == 0) for frame in range(4 * MISSED)]
    chosen = [key[1] for key, _ in choose_targets(many)]
    missed, right = ([f for f in chosen if f % 2 == odd] for odd in (1, 0))
    assert (len(missed), len(right)) == (MISSED, RIGHT)
    assert max(np.diff(missed)) <= 4 and missed[0] < 10 and missed[-1] > 4 * MISSED - 10


def test_what_goes_wrong_is_logged_and_costs_nothing(
    tmp_path: Any, caplog: pytest.LogCaptureFixture
) -> None:
    broken: Any = None
    keep_material(broken, broken, [], [], tmp_path)
    assert "pictures of the report could not be made" in caplog.text
