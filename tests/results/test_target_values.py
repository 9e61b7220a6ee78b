"""`targets.csv` is read as it was written, and what is wrong with it is named."""

from pathlib import Path

import pytest

from hlp.errors import DataError
from hlp.results.summary_file import numbered_targets, read_target_values, write_target_values


def test_values_are_read_as_they_were_written(tmp_path: Path) -> None:
    values = {
        "est/est": {(1, 4, 2, 0): 1.0, (1, 4, 2, 1): 0.0},
        "ms first": {(1, 4, 2, 0): 0.1 + 0.2},
        "none": {},
    }
    write_target_values(tmp_path, values, {2: 'cup, "red"'})
    assert read_target_values(tmp_path) == values
    first = (tmp_path / "targets.csv").read_text().splitlines()[0]
    assert first == "scene_id,im_id,obj_id,instance,object,est/est,ms first,none"


def test_a_folder_without_them_has_none(tmp_path: Path) -> None:
    assert read_target_values(tmp_path) == {}


def test_instances_are_numbered_in_their_order() -> None:
    targets = [(1, 4, 2), (1, 4, 3), (1, 4, 2), (1, 5, 2)]
    assert numbered_targets(targets) == [(1, 4, 2, 0), (1, 4, 3, 0), (1, 4, 2, 1), (1, 5, 2, 0)]


HEADER = "scene_id,im_id,obj_id,instance,object,pso\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "first line must be scene_id"),
        ("scene_id,im_id\n1,2\n", "first line must be scene_id"),
        (f"{HEADER}1,1,1,0,cat,0.5\n1,1,one,0,cat,0.5\n", "line 3: no target .*one"),
        (f"{HEADER}1,1,1,0,cat,much\n", "line 2: no target .*much"),
        (f"{HEADER}1,1,1,0,cat\n", "line 2: no target"),
        (f"{HEADER}1,1,1,0,cat,nan\n", "line 2: a value is not finite"),
    ],
)
def test_a_damaged_file_is_named(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "targets.csv").write_text(content)
    with pytest.raises(DataError, match=rf"targets\.csv.*{message}"):
        read_target_values(tmp_path)
