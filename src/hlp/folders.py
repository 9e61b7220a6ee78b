"""Folders that may come from somebody else: nothing that is opened in one lies outside of it.

A link in there may lead to any file of the user's, and a pipe would be read for ever. So a folder
is looked through before anything in it is opened; what its own files name is found by `inside`.
"""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

from hlp.errors import DataError, InputError

_DEEPEST = 64  # folders within each other
_LONGEST = 255  # bytes of a name


def own_files(folder: Path) -> list[Path]:
    """All files in a folder and those below it; the folder itself may be a link.

    Raises DataError for a link that leads out of it, what is neither a file nor a folder, and more
    folders within each other than anybody makes.
    """
    files, root = [], os.path.realpath(folder)
    for entry, depth in _entries(folder):
        path, link = Path(entry), entry.is_symlink()
        if link and not Path(os.path.realpath(path)).is_relative_to(root):
            raise DataError(f"{path} is a link that leads out of {folder}: copy or remove it")
        if depth > _DEEPEST:
            raise DataError(f"{path} lies below {_DEEPEST} folders: remove it")
        if entry.is_file(follow_symlinks=False) or (link and path.is_file()):
            files.append(path)
        elif not link and not entry.is_dir():
            raise DataError(f"{path} is neither a file nor a folder: remove it")
    return files


def found_below(root: Path, name: str) -> list[Path]:
    """What has a name in or below a folder.

    Left out with a warning is what lies in a folder for which `own_files` raises an error.
    """
    found = []
    for path in sorted(Path(entry) for entry, _ in _entries(root) if entry.name == name):
        try:
            own_files(path.parent)
            found.append(path)
        except DataError as error:
            logging.getLogger(__name__).warning("left out: %s", error)
    return found


def _entries(folder: Path) -> Iterator[tuple["os.DirEntry[str]", int]]:
    """Everything in and below a folder, with the number of folders that it lies in."""
    waiting = [(os.fspath(folder), 1)]
    while waiting:
        inner, depth = waiting.pop()
        # Another process may remove it meanwhile, and some may not be read.
        away = FileNotFoundError, NotADirectoryError, PermissionError
        with suppress(*away), os.scandir(inner) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False) and depth <= _DEEPEST:
                    waiting.append((entry.path, depth + 1))
                yield entry, depth


def inside(folder: Path, name: str) -> Path:
    """The path of a file that a folder's own files name. Raises DataError for one outside."""
    path = Path(name)
    too_long = any(len(os.fsencode(part)) > _LONGEST for part in path.parts)
    if path.is_absolute() or ".." in path.parts or too_long:
        raise DataError(f"{folder} names a file outside of it: {name}")
    return folder / path


def lock_file(path: Path) -> FileIO:
    """Open the file of a lock, which is made but never emptied. Raises InputError for a link.

    A folder in its place is kept beside it.
    """
    if path.is_dir() and not path.is_symlink():
        path.rename(path.with_name(f"{path.name}.{os.getpid()}"))
    try:
        return FileIO(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644))
    except OSError as error:
        if path.is_symlink():
            raise InputError(f"{path} is a link, which no lock is: remove it") from error
        raise


@contextmanager
def locked(path: Path, problem: str) -> Iterator[None]:
    """Hold the lock of a file; the system frees that of a dead process.

    Raises InputError with the `problem` while another process holds it.
    """
    with lock_file(path) as lock:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError) as error:
            raise InputError(problem) from error
        yield
