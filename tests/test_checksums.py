"""Checksums of files and seals of records: what is whole is said to be, and any change is found."""

import copy
import json
import os
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from generated_values import json_values, texts
from hlp.errors import DataError
from hlp.fingerprints import (
    content_checksum,
    file_checksum,
    find_damaged,
    folder_checksums,
    seal_is_whole,
    sealed,
)


def test_file_and_content_have_one_checksum_that_of_xxh3_128(tmp_path: Path) -> None:
    """The value is one of xxHash's own test suite: the empty input with seed 0."""
    for content in (b"", os.urandom(1_000_003)):
        (tmp_path / "file").write_bytes(content)
        assert file_checksum(tmp_path / "file") == content_checksum(content)
    assert content_checksum(b"") == "99aa06d3014798d86001c324468d497f"


def test_every_changed_byte_is_found(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "file").write_bytes(bytes(range(64)))
    (tmp_path / "other").touch()
    (tmp_path / ".hidden").touch()
    checksums = folder_checksums(tmp_path, leaving_out=("other",))
    assert list(checksums) == ["sub/file"]
    assert list(find_damaged(tmp_path, checksums)) == []
    for at in range(64):
        changed = bytearray(range(64))
        changed[at] ^= 1
        (tmp_path / "sub" / "file").write_bytes(changed)
        assert list(find_damaged(tmp_path, checksums)) == ["sub/file"]
    (tmp_path / "sub" / "file").unlink()
    assert list(find_damaged(tmp_path, checksums)) == ["sub/file"]


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/../../b"])
def test_no_file_outside_the_folder_is_read(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="outside"):
        list(find_damaged(tmp_path, {name: "0"}))


RECORDS = st.dictionaries(texts(), json_values(), max_size=5)


@given(RECORDS, texts(), json_values(), st.data())
def test_a_seal_is_whole_after_writing_and_reading_until_anything_changes(
    record, name, value, data
):
    assume("checksum" not in record and name != "checksum")
    whole = json.loads(json.dumps(sealed(record), indent=2))
    assert seal_is_whole(dict(reversed(whole.items())))
    assert not seal_is_whole(record) and not seal_is_whole([whole])
    changed = copy.deepcopy(whole)
    if name in changed and data.draw(st.booleans()):
        del changed[name]
    else:
        changed[name] = value
    same = json.dumps(changed, sort_keys=True) == json.dumps(whole, sort_keys=True)
    assert seal_is_whole(changed) == same
