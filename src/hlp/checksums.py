"""Checksums of files and records: they find what a disk, a copy or an editor has changed.

XXH3 with 128 bits: 300 MB of cached data in 0.04 s, where BLAKE2b takes 0.44 s. It is no protection
against somebody who wants a file to look unchanged.
"""

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import xxhash

from hlp.errors import DataError

_SEAL = "checksum"


def file_checksum(path: Path) -> str:
    """Checksum (32 hex digits) of a file's content. Raises OSError if it cannot be read."""
    with path.open("rb") as stream:
        return str(hashlib.file_digest(stream, xxhash.xxh3_128).hexdigest())


def content_checksum(content: bytes | memoryview) -> str:
    """Checksum (32 hex digits) of some bytes; that of a file if they are its content."""
    return str(xxhash.xxh3_128(content).hexdigest())


def folder_checksums(folder: Path, leaving_out: Collection[str] = ()) -> dict[str, str]:
    """Checksum of every file in a folder and those below it, by its path in the folder.

    Files and folders whose names begin with a dot are no part of the content.
    """
    paths = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    names = sorted(
        path.as_posix() for path in paths if not any(part.startswith(".") for part in path.parts)
    )
    return {name: file_checksum(folder / name) for name in names if name not in leaving_out}


def find_damaged(folder: Path, checksums: Mapping[str, str]) -> Iterator[str]:
    """Names of the files that are missing or not as their checksums.

    Files without a checksum are ignored. Raises DataError for the name of a file outside the
    folder, which no `folder_checksums` gives.
    """
    for name, expected in checksums.items():
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise DataError(f"{folder} names a file outside of it: {name}")
        path = folder / name
        if not path.is_file() or file_checksum(path) != expected:
            yield name


def sealed(record: Mapping[str, Any]) -> dict[str, Any]:
    """The record with a checksum of itself. Its values must be JSON's."""
    return {**record, _SEAL: _record_checksum(record)}


def is_sealed(record: Mapping[str, Any]) -> bool:
    """Whether a record has a checksum, be it right or wrong."""
    return _SEAL in record


def seal_is_whole(record: object) -> bool:
    """Whether a value read from JSON is a record that `sealed` gave, unchanged."""
    return isinstance(record, dict) and record.get(_SEAL) == _record_checksum(
        {key: value for key, value in record.items() if key != _SEAL}
    )


def _record_checksum(record: Mapping[str, Any]) -> str:
    text = json.dumps(record, sort_keys=True, separators=(",", ":"))
    return content_checksum(text.encode())
