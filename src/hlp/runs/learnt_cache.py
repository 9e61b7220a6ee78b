"""Where what is learnt lies: folders with names in the user's cache."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from hlp.errors import InputError, MissingFileError
from hlp.method.learnt_folder import RECORD, LearntRecord, read_record
from hlp.method.unfinished_folder import bring_back


@dataclass(frozen=True)
class LearntEntry:
    """A folder of learnt objects: its name, its place, its size on disk (bytes)."""

    name: str
    folder: Path
    size: int
    record: LearntRecord


def cache_folder(work: str | None) -> Path:
    """The folder of all that is learnt: the user's cache, or `work`/objects."""
    if work is not None:
        return Path(work).expanduser().absolute() / "objects"
    return platformdirs.user_cache_path("hlp", appauthor=False) / "objects"


def find_learnt(given: str, cache: Path) -> Path:
    """The folder that a path or a name in the cache stands for.

    Raises MissingFileError if there is no such folder, naming those in the cache.
    """
    path = Path(given).expanduser()
    bring_back(path.resolve())
    if (path / RECORD).is_file():
        return path
    named = cache / given
    if Path(given).name == given:
        bring_back(named)
        if (named / RECORD).is_file():
            return named
    known = ", ".join(each.name for each in list_learnt(cache)) or "nothing"
    raise MissingFileError(
        f"learnt={given}: neither a folder of learnt objects nor a name; {cache} holds {known}. "
        "Learn objects with `hlp learn mesh=FILE`"
    )


def list_learnt(cache: Path) -> list[LearntEntry]:
    """Everything in the cache, by name. Raises DataError for a damaged record."""
    if not cache.is_dir():
        return []
    folders = sorted(path.parent for path in cache.glob(f"*/{RECORD}"))
    return [describe_learnt(folder) for folder in folders]


def describe_learnt(folder: Path) -> LearntEntry:
    """Name, size and content of a folder of learnt objects."""
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return LearntEntry(folder.name, folder, size, read_record(folder))


def remove_learnt(name: str, cache: Path) -> Path:
    """Delete an entry of the cache; the folder that was deleted.

    Raises MissingFileError if there is none of that name, InputError for a path: only what lies in
    the cache is deleted.
    """
    if Path(name).name != name or name in {"", ".", ".."}:
        raise InputError(f"{name} is no name in {cache}: delete other folders yourself")
    folder = find_learnt(name, cache) if (cache / name / RECORD).is_file() else None
    if folder is None or folder.parent != cache:
        known = ", ".join(each.name for each in list_learnt(cache)) or "nothing"
        raise MissingFileError(f"{cache} holds no {name}; it holds {known}")
    shutil.rmtree(folder)
    return folder


def export_learnt(name: str, target: Path, cache: Path) -> Path:
    """Copy learnt objects into a new folder. Raises InputError if it is there already."""
    source = find_learnt(name, cache)
    if target.exists():
        raise InputError(f"{target} is there already: name a new folder")
    shutil.copytree(source, target)
    return target
