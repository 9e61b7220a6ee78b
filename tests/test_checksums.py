import os
from pathlib import Path

import pytest

from hlp.checksums import (
    content_checksum,
    file_checksum,
    find_damaged,
    folder_checksums,
    seal_is_whole,
    sealed,
)
from hlp.errors import DataError


def test_checksum_is_that_of_xxh3_128(tmp_path: Path) -> None:
    """A value of xxHash's own test suite: the empty input with seed 0."""
    (tmp_path / "empty").touch()
    assert file_checksum(tmp_path / "empty") == "99aa06d3014798d86001c324468d497f"
    assert content_checksum(b"") == "99aa06d3014798d86001c324468d497f"


def test_file_and_content_have_one_checksum_whatever_the_size(tmp_path: Path) -> None:
    content = os.urandom(1_000_003)
    (tmp_path / "large").write_bytes(content)
    assert file_checksum(tmp_path / "large") == content_checksum(content)


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


def test_a_sealed_record_shows_any_change() -> None:
    record = {"b": 1.5, "a": [1, "x"], "c": {"d": None}}
    whole = sealed(record)
    assert seal_is_whole(whole)
    assert seal_is_whole(dict(reversed(whole.items())))
    assert not seal_is_whole(record)
    assert not seal_is_whole(whole | {"b": 1.25})
    assert not seal_is_whole(whole | {"e": 0})
    assert not seal_is_whole([whole])
