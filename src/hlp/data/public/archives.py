"""Unpacking of archives that somebody else made: nothing leads out of the folder, or fills a disk.

Members must be plain files and folders below the archive's root: no absolute paths, no `..`, no
links, no devices. What they take unpacked is stated in the archive and limited before anything is
written; Python's readers take no more of a member than is stated.
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

_MOST_RATIO = 20.0  # unpacked bytes per packed one; images and binary meshes have about 1 to 4
_FREE_OF_RATIO = 50_000_000  # bytes: text may be packed better
_RESERVE = 50e6  # bytes that stay free
_ENCRYPTED = 0x1
_BROKEN = (
    zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, NotImplementedError,
    UnicodeDecodeError,
)  # fmt: skip


@dataclass(frozen=True)
class Member:
    """What an archive states of a file or folder in it, and how it is opened."""

    name: str
    size: int
    is_folder: bool
    is_plain: bool
    open: Callable[[], IO[bytes] | None]


def unpack(archive: Path, folder: Path, root: str) -> int:
    """Unpack a zip or tar file into a folder; the number of files.

    A folder called `root` that stands around members is left away. Raises DataError naming the
    archive and the member for anything but plain files below the archive's root, and for a damaged
    archive; DiskFullError if the disk has too little room.
    """
    try:
        with _opened(archive) as members:
            files = _checked(archive, members)
            total, packed = sum(member.size for member in members), archive.stat().st_size
            if total > _MOST_RATIO * packed + _FREE_OF_RATIO:
                raise DataError(
                    f"{archive} takes {packed} bytes and states {total} unpacked: no data set does "
                    "that, it is not unpacked"
                )
            require_room(folder, total, f"{archive.name} unpacked")
            for path, member in files.items():
                inner = path.parts[1:] if path.parts[0] == root else path.parts
                target = folder.joinpath(*(inner or path.parts))
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("wb") as stream:
                    shutil.copyfileobj(member.open(), stream)  # type: ignore[arg-type]
            return len(files)
    except _BROKEN as error:
        raise DataError(f"{archive} is damaged ({error}): delete it and call again") from error


def require_room(folder: Path, needed: float, what: str) -> None:
    """Raise DiskFullError unless a folder's disk has room for so many bytes."""
    free = shutil.disk_usage(folder).free
    if needed + _RESERVE > free:
        raise DiskFullError(
            f"{folder} has {free / 1e9:.1f} GB free, {what} takes {needed / 1e9:.1f}: free some, "
            "or choose another disk with output=FOLDER"
        )


@contextmanager
def _opened(archive: Path) -> Iterator[list[Member]]:
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as packed:
            yield [
                Member(
                    # Names end at a zero byte in `filename`.
                    info.orig_filename, info.file_size, info.is_dir(), _is_plain(info),
                    partial(packed.open, info),
                )
                for info in packed.infolist()
            ]  # fmt: skip
    else:
        with tarfile.open(archive) as tape:
            yield [
                Member(
                    info.name, info.size, info.isdir(), info.isreg() or info.isdir(),
                    partial(tape.extractfile, info),
                )
                for info in tape
            ]  # fmt: skip


def _is_plain(info: zipfile.ZipInfo) -> bool:
    kind = stat.S_IFMT(info.external_attr >> 16)
    return not info.flag_bits & _ENCRYPTED and kind in (0, stat.S_IFREG, stat.S_IFDIR)


def _checked(archive: Path, members: Sequence[Member]) -> dict[PurePosixPath, Member]:
    """The files by their paths, none twice and none a folder of another."""
    files: dict[PurePosixPath, Member] = {}
    for member in members:
        if not member.is_plain:
            raise _unsafe(archive, member.name, "is encrypted, a link or a device")
        parts = member.name.rstrip("/").split("/")
        inner = parts[1:] if parts[0] == "." else parts
        odd = any(part in ("", ".", "..") or part.strip() != part for part in inner)
        if odd or any(sign in member.name for sign in ("\\", "\0", ":")):
            raise _unsafe(archive, member.name, "leads out of the folder, or may on some system")
        if not member.is_folder:
            path = PurePosixPath(*inner)
            if path in files or not inner:
                raise _unsafe(archive, member.name, "is there twice")
            files[path] = member
    for path, member in files.items():
        if any(parent in files for parent in path.parents):
            raise _unsafe(archive, member.name, "lies in a member that is no folder")
    return files


def _unsafe(archive: Path, name: str, problem: str) -> DataError:
    return DataError(f"{archive}: its member {name!r} {problem}: it is not unpacked")
