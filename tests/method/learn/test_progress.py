"""Progress lines of learning, on a terminal and elsewhere."""

from typing import Any

import pytest

from hlp.method.learn.progress import counting_objects


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


def test_nothing_is_said_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    counted = counting_objects(read_views, "windows cut", 1)
    counted(1)
    assert capsys.readouterr() == ("", "")
