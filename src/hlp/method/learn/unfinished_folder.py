"""A folder of learnt objects in the making: continued after an interruption, published whole."""

import logging
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from hlp.errors import DamagedError, DataError, InputError, MissingFileError
from hlp.files import read_json, remove_unfinished, write_json
from hlp.fingerprints import find_damaged, folder_checksums, seal_is_whole, sealed
from hlp.folders import locked, own_files
from hlp.method.learn.learnt_folder import (
    RECORD,
    LearntRecord,
    check_files,
    read_record,
    write_record,
)

# Their names begin with a dot, so that they are no part of what is learnt.
VIEWS = ".views"
_DONE, _REQUEST = ".done.json", ".request.json"
_logger = logging.getLogger(__name__)


@contextmanager
def folder_in_the_making(
    folder: Path, request: Mapping[str, str], replaces: bool = False
) -> Iterator[Path]:
    """A folder beside `folder` that replaces it when the block ends without an error.

    A folder left by an interrupted call is continued if it is for the same `request`.
    """
    folder = folder.resolve()  # "." has no name, and a link is to stay one
    restore_replaced(folder)
    if folder.exists() and not replaces and not _set_aside_damaged(folder):
        what = "holds learnt objects" if (folder / RECORD).is_file() else "is there"
        raise InputError(f"{folder} {what} already: load it, or name another folder")
    partial = folder.with_name(folder.name + ".partial")
    if os.path.lexists(partial):
        begun = (partial / _REQUEST).is_file() or (partial.is_dir() and not any(partial.iterdir()))
        if partial.is_symlink() or not begun:
            raise InputError(f"{partial} is in the way: rename it, or name another folder")
        own_files(partial)
    with _locked(folder):
        if partial.exists() and _read_json_or_none(partial / _REQUEST) != request:
            shutil.rmtree(partial)
        partial.mkdir(parents=True, exist_ok=True)
        write_json(partial / _REQUEST, request)
        yield partial
        _publish(partial, folder, replaces)
    _logger.info("learnt %s", folder)


def restore_replaced(folder: Path) -> None:
    """Put a folder back that a killed process was replacing and left under a hidden name.

    That process had renamed the old folder, but not yet the new one: the latter is still there as
    `.partial`, and the call that was killed continues with it. Raises InputError while another
    process is replacing the folder. What a process that was killed after that has left in the
    folder is removed. Only for folders that HLP writes into: those that it reads may be anybody's.
    """
    if (folder / RECORD).is_file() and (folder / _REQUEST).is_file():
        _remove_markers(folder)
    if left_behind(folder) is None:
        return
    with _locked(folder):
        if not folder.exists():
            _hidden(folder).rename(folder)
            _logger.warning("%s is restored: a process was killed while replacing it", folder)


def _hidden(folder: Path) -> Path:
    """Where a folder lies while another one takes its place."""
    return folder.with_name(f".{folder.name}.replaced")


def left_behind(folder: Path) -> Path | None:
    """What a killed process has renamed a folder to, if it was replacing it."""
    hidden, request = _hidden(folder), folder.with_name(folder.name + ".partial") / _REQUEST
    killed = not folder.exists() and request.is_file() and (hidden / RECORD).is_file()
    return hidden if killed else None


def _set_aside_damaged(folder: Path) -> bool:
    """Rename a folder of learnt objects that is damaged, and say why; False for any other."""
    if not (folder / RECORD).is_file():
        return False
    try:
        check_files(folder, read_record(folder))
    except (DamagedError, MissingFileError) as error:
        endings = ("", *(f"-{number}" for number in range(2, 1000)))
        asides = (folder.with_name(f"{folder.name}.damaged{ending}") for ending in endings)
        aside = next(path for path in asides if not path.exists())
        folder.rename(aside)
        _logger.warning("%s: kept as %s", error, aside.name)
        return True
    except DataError:  # of another version: not ours to judge
        return False
    return False


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other processes from learning into the same folder. Raises what `locked` raises."""
    path = folder.with_name(f".{folder.name}.lock")
    path.parent.mkdir(parents=True, exist_ok=True)
    with locked(path, f"another process is learning into {folder.name}: wait for it"):
        yield
        with suppress(OSError):  # on Windows, it is open
            path.unlink()


def _publish(partial: Path, folder: Path, replaces: bool) -> None:
    """Put a finished folder in its place; then remove what only an interrupted call would need."""
    if replaces:
        shutil.rmtree(_hidden(folder), ignore_errors=True)  # half removed by a killed call
        folder.rename(_hidden(folder))
    partial.rename(folder)
    if replaces:
        shutil.rmtree(_hidden(folder), ignore_errors=True)
    _remove_markers(folder)


def _remove_markers(folder: Path) -> None:
    """Remove what only an interrupted call would need; the request last, which shows the rest."""
    shutil.rmtree(folder / VIEWS, ignore_errors=True)
    for name in (_DONE, _REQUEST):
        for path in folder.rglob(name):
            with suppress(OSError):  # another process does the same, or it may only be read
                path.unlink()


def finish(partial: Path, record: LearntRecord) -> None:
    """Write `learnt.json`, with the checksums of all files. It is written last."""
    remove_unfinished(partial)
    write_record(partial, replace(record, files=folder_checksums(partial, leaving_out=(RECORD,))))


def once(folder: Path, make: Callable[[Path], None]) -> None:
    """Make a folder's content, unless it was made before.

    A marker holds the checksums of the files: if one is damaged, the content is made again.
    """
    made = _read_json_or_none(folder / _DONE)
    if not seal_is_whole(made) or any(find_damaged(folder, made["files"])):
        folder.mkdir(parents=True, exist_ok=True)
        make(folder)
        write_json(folder / _DONE, sealed({"files": folder_checksums(folder)}))


def _read_json_or_none(path: Path) -> Any:
    try:
        return read_json(path)
    except (OSError, DataError):
        return None
