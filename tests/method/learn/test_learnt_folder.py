"""The record of a folder of learnt objects."""

import json

import pytest

from hlp.checksums import sealed
from hlp.errors import DamagedError, DataError
from hlp.method.learn.learnt_folder import LearntRecord, read_record, write_record
from hlp.method.settings import MethodSettings

RECORD = LearntRecord({"bear": 1, "can": 4}, (1, 3, 4), MethodSettings(), {"a/b": "0"})


def test_a_record_comes_back(tmp_path):
    write_record(tmp_path, RECORD)
    assert read_record(tmp_path) == RECORD


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"objects": ["bear"]}, "objects is ['bear']: it must be a mapping"),
        ({"objects": {"bear": 1.5}}, "objects.bear is 1.5: it must be a whole number"),
        ({"objects": {"bear": -1}}, "objects is -1: it must be at least 0"),
        ({"classes": {}}, "classes is {}: it must be a list"),
        ({"classes": ["1"]}, "classes.0 is '1': it must be a whole number"),
        ({"files": {"a": None}}, "files.a is None: it must be text"),
        ({"settings": 7}, "settings is 7: it must be a mapping"),
        ({"settings": {"seed": "0"}}, "settings: seed is '0': it must be a whole number"),
    ],
)
def test_a_record_that_is_not_as_its_schema_is_named(tmp_path, values, words):
    write_record(tmp_path, RECORD)
    path = tmp_path / "learnt.json"
    content = json.loads(path.read_text()) | values
    del content["checksum"]
    path.write_text(json.dumps(sealed(content)))
    with pytest.raises(DataError) as caught:
        read_record(tmp_path)
    assert f"{path}: {words}" in str(caught.value)
    assert isinstance(caught.value, DamagedError) == ("seed" not in words)
