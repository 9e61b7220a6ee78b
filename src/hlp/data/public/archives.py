"""Unpacking of archives that somebody else made: nothing leads out of the folder, or fills a disk.

Members must be plain files and folders below the archive's root: no absolute paths, no `..`, no
links, no devices. What they take unpacked is stated in the archive and limited before anything is
written; while writing, a member that is larger than stated is an error.
"""

import shutil
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

from hlp.errors import DataError, DiskFullError

_MOST_MEMBERS = 2_000_000
_MOST_RATIO = 20.0  # unpacked bytes per packed one; images and binary meshes have about 1 to 4
_FREE_OF_RATIO = 50_000_000  # bytes: text may be packed better
_RESERVE = 50e6  # bytes that stay free
_CHUNK = 1 << 20
_ENCRYPTED = 0x1
_BROKEN = (
    zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, NotImplementedError,
    UnicodeDecodeError,
)  # fmt: skip


@dataclass(frozen=True)
class Member:
    """A file in an archive: its path below the root, its stated size (bytes), how to open it."""

    path: PurePosixPath
    size: int
    open: Callable[[], IO[bytes]]


def unpack(archive: Path, folder: Path, root: str) -> int:
    """Unpack a zip or tar file into a folder; the number of files.

    A folder called `root` that stands around members is left away. Raises DataError naming the
    archive and the member for anything but plain files below the archive's root, and for a damaged
    archive; DiskFullError if the disk has too little room.
    """
    try:
        with _members(archive) as members:
            _check_sizes(archive, members, folder)
            for member in members:
                _write(archive, member, folder.joinpath(*_without(root, member.path)))
            return len(members)
    except _BROKEN as error:
        raise DataError(f"{archive} is damaged ({error}): delete it and call again") from error


def _without(root: str, path: PurePosixPath) -> tuple[str, ...]:
    return path.parts[1:] if path.parts[0] == root and len(path.parts) > 1 else path.parts


@contextmanager
def _members(archive: Path) -> Iterator[list[Member]]:
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as packed:
            yield _checked(archive, _of_zip(archive, packed))
    else:
        with tarfile.open(archive) as tape:
            yield _checked(archive, _of_tar(archive, tape))


def _of_zip(archive: Path, packed: zipfile.ZipFile) -> Iterator[Member]:
    for info in packed.infolist():
        kind = stat.S_IFMT(info.external_attr >> 16)
        if info.flag_bits & _ENCRYPTED or kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise _unsafe(archive, info.filename, "is encrypted, a link or a device")
        path = _safe_path(archive, info.orig_filename)
        if not info.is_dir():
            yield Member(path, info.file_size, partial(packed.open, info))


def _of_tar(archive: Path, tape: tarfile.TarFile) -> Iterator[Member]:
    for info in tape:
        if not (info.isreg() or info.isdir()):
            raise _unsafe(archive, info.name, "is a link or a device")
        path = _safe_path(archive, info.name)
        if info.isreg():
            yield Member(path, info.size, partial(_opened, tape, info))


def _opened(tape: tarfile.TarFile, info: tarfile.TarInfo) -> IO[bytes]:
    stream = tape.extractfile(info)
    assert stream is not None  # it is a regular file
    return stream


def _safe_path(archive: Path, name: str) -> PurePosixPath:
    path = PurePosixPath(name)
    parts = name.rstrip("/").split("/")
    if parts[0] == ".":
        parts = parts[1:]
    odd = any(part in ("", ".", "..") or part.strip() != part for part in parts)
    if path.is_absolute() or (odd and parts) or any(each in name for each in ("\\", "\0", ":")):
        raise _unsafe(archive, name, "leads out of the folder, or may do so on some system")
    return PurePosixPath(*parts)


def _checked(archive: Path, found: Iterator[Member]) -> list[Member]:
    """All members, none twice and none a folder of another."""
    members: dict[PurePosixPath, Member] = {}
    for number, member in enumerate(found):
        if member.path in members or not member.path.parts:
            raise _unsafe(archive, str(member.path), "is there twice")
        if number >= _MOST_MEMBERS:
            raise _unsafe(archive, str(member.path), f"is one of more than {_MOST_MEMBERS}")
        members[member.path] = member
    for member in members.values():
        if any(parent in members for parent in member.path.parents):
            raise _unsafe(archive, str(member.path), "lies in a member that is no folder")
    return list(members.values())


def _check_sizes(archive: Path, members: Sequence[Member], folder: Path) -> None:
    total, packed = sum(each.size for each in members), archive.stat().st_size
    if total > _MOST_RATIO * packed + _FREE_OF_RATIO:
        raise DataError(
            f"{archive} takes {packed} bytes and states {total} unpacked: no data set does that, "
            "it is not unpacked"
        )
    free = shutil.disk_usage(folder).free
    if total + _RESERVE > free:
        raise DiskFullError(
            f"{folder} has {free / 1e9:.1f} GB free, {archive.name} takes {total / 1e9:.1f} "
            "unpacked: free some, or choose another disk with output=FOLDER"
        )


def _write(archive: Path, member: Member, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    left = member.size
    with member.open() as source, target.open("wb") as stream:
        while chunk := source.read(_CHUNK):
            left -= len(chunk)
            if left < 0:
                break
            stream.write(chunk)
    if left != 0:
        raise _unsafe(archive, str(member.path), f"does not have {member.size} bytes as stated")


def _unsafe(archive: Path, name: str, problem: str) -> DataError:
    return DataError(f"{archive}: its member {name!r} {problem}: it is not unpacked")
