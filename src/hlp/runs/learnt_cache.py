"""Where what is learnt lies: folders with names in the user's cache."""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from hlp.errors import DataError, InputError, MissingFileError
from hlp.files import EXAMPLE, expanded, shipped_folder
from hlp.folders import own_files
from hlp.method.learn.learnt_folder import RECORD, read_record
from hlp.method.learn.unfinished_folder import restore_replaced

_REMOVED = ".removed-"


@dataclass(frozen=True)
class LearntEntry:
    """A folder of learnt objects: its name, its place, its size on disk (bytes), its content.

    Of a folder that cannot be used, there is a `problem` in place of the names of `objects`.
    """

    name: str
    folder: Path
    size: int
    objects: tuple[str, ...]
    problem: str = ""


def cache_folder(work: str | None) -> Path:
    """The folder of all that is learnt: the user's cache, or `work`/objects."""
    if work is not None:
        return expanded(work).absolute() / "objects"
    return platformdirs.user_cache_path("hlp", appauthor=False) / "objects"


def find_learnt(given: str, cache: Path) -> Path:
    """The folder that a path or a name in the cache stands for, or `example`, which HLP ships.

    Raises MissingFileError if there is no such folder, naming those in the cache.
    """
    path = expanded(given)
    if (path / RECORD).is_file():
        return path
    named = cache / given
    if Path(given).name == given:
        restore_replaced(named)
        if (named / RECORD).is_file():
            return named
    if given == EXAMPLE:
        return shipped_folder(EXAMPLE) / "learnt"
    raise MissingFileError(
        f"learnt={given}: neither a folder of learnt objects nor a name; {cache} holds "
        f"{_names(cache)}. Learn objects with `hlp learn mesh=FILE`"
    )


def list_learnt(cache: Path) -> list[LearntEntry]:
    """Everything in the cache, by name, also what is damaged."""
    entries = []
    for folder in sorted(path.parent for path in cache.glob(f"*/{RECORD}")):
        try:
            entries.append(describe_learnt(folder))
        except DataError as error:
            entries.append(LearntEntry(folder.name, folder, 0, (), str(error)))
    return entries


def _names(cache: Path) -> str:
    return ", ".join(entry.name for entry in list_learnt(cache)) or "nothing"


def describe_learnt(folder: Path) -> LearntEntry:
    """Name, size and content of a folder of learnt objects. Raises DataError if it is damaged."""
    objects = tuple(read_record(folder).objects)
    size = sum(path.stat().st_size for path in own_files(folder))
    return LearntEntry(folder.name, folder, size, objects)


def remove_learnt(name: str, cache: Path) -> Path:
    """Delete an entry of the cache; the folder that was deleted.

    Raises MissingFileError if there is none of that name, InputError for a path: only what lies in
    the cache is deleted.
    """
    if Path(name).name != name or name in {"", ".", ".."}:
        raise InputError(f"{name} is not a name in {cache}: delete other folders yourself")
    folder = cache / name
    if not (folder / RECORD).is_file():
        raise MissingFileError(f"{cache} holds no {name}; it holds {_names(cache)}")
    hidden = tempfile.mkdtemp(prefix=_REMOVED, dir=cache)  # a killed call leaves no half of it
    folder.rename(Path(hidden, name))
    shutil.rmtree(hidden)
    for left in cache.glob(f"{_REMOVED}*"):  # by calls that were killed
        shutil.rmtree(left, ignore_errors=True)
    return folder


def export_learnt(source: Path, target: Path) -> None:
    """Copy learnt objects into a new folder, which appears when it is complete.

    Raises InputError if it is there already.
    """
    if target.exists():
        raise InputError(f"{target} exists already: name a new folder")
    partial = target.absolute().with_name(f".{target.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)  # left by a call that was killed
    shutil.copytree(source, partial)
    partial.rename(target)
