"""Windows by object and by the classifier's class."""

import numpy as np

from hlp.reporting.figures.bench_bars import Confusion, draw_confusion

COUNTS = {"cat": {"cat": 7, "background": 3}, "duck": {"lamp": 1, "duck": 1}}


def test_columns_are_the_objects_then_other_classes_then_background():
    found = Confusion.of(COUNTS)
    assert found.objects == ("cat", "duck")
    assert found.classes == ("cat", "duck", "lamp", "background")
    np.testing.assert_array_equal(found.counts, [[7, 0, 0, 3], [0, 1, 1, 0]])
    assert found.right == 8
    np.testing.assert_allclose(found.shares, [[0.7, 0, 0, 0.3], [0, 0.5, 0.5, 0]])


def test_the_figure_is_written_unless_there_is_no_window(tmp_path):
    draw_confusion(tmp_path, {})
    assert not list(tmp_path.iterdir())
    draw_confusion(tmp_path, COUNTS)
    assert {path.name for path in tmp_path.iterdir()} == {"confusion.png", "confusion.svg"}
