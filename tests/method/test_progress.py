"""Progress lines of learning, on a terminal and elsewhere."""

from typing import Any

import pytest

from hlp.method.find.estimator import PoseEstimator
from hlp.method.progress import CountingEstimator, counting_objects


def read_views(object_id: int) -> Any:
    return f"views of {object_id}"


def test_objects_are_counted_once_and_their_views_passed_on(
    terminal: pytest.CaptureFixture[str],
) -> None:
    counted = counting_objects(read_views, "windows cut", 3)
    assert terminal.readouterr().err == ""
    assert [counted(i) for i in (4, 7, 9)] == [read_views(i) for i in (4, 7, 9)]
    said = terminal.readouterr().err
    assert "windows cut: 100%" in said and "3/3" in said and "object/s" in said
    assert counted(4) == read_views(4)
    assert terminal.readouterr().err == ""


def test_scenes_of_an_object_are_counted_while_its_score_is_calibrated(
    terminal: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PoseEstimator, "prepare", lambda self, frame, mask: (frame, mask))
    estimator, frame = object.__new__(CountingEstimator), Any
    with estimator.counting("bear", 2):
        assert [estimator.prepare(frame), estimator.prepare(frame)] == [(frame, None)] * 2
    said = terminal.readouterr().err
    assert "score of bear: 100%" in said and "2/2" in said and "scene/s" in said
    estimator.prepare(frame)
    with estimator.counting("bear", 0):
        pass
    assert terminal.readouterr().err == ""


def test_nothing_is_said_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    counted = counting_objects(read_views, "windows cut", 1)
    counted(1)
    with object.__new__(CountingEstimator).counting("bear", 2):
        pass
    assert capsys.readouterr() == ("", "")
