"""What may go from a store: partial outputs of crashed runs, damaged ones, unreferenced ones."""

import shutil
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlp.errors import DataError, MissingFileError
from hlp.files import MANIFEST
from hlp.stages.fingerprint import is_fingerprint
from hlp.stages.manifest import read_manifest
from hlp.stages.store import DAMAGED, PARTIAL, RECORD
from hlp.stages.store_use import unused

KINDS = ("partial", "damaged", "unreferenced")


@dataclass(frozen=True)
class Removable:
    """An output that may go: `kind` is one of `KINDS`, `size` in bytes."""

    kind: str
    folder: Path
    size: int


def find_removable(work: Path, results: Iterable[Path]) -> list[Removable]:
    """What may go from the store in `work`.

    An output is unreferenced if no manifest below the folders of `results` names it. Without any
    manifest none is. Raises MissingFileError if there is no store, DataError for a broken manifest.
    """
    if not work.is_dir():
        raise MissingFileError(f"there is no folder {work}: name the one of the runs, work=DIR")
    named = set(_referred_to(results))
    found = []
    for folder in sorted(work.glob("*/*")):
        kind = _kind(folder, named)
        if kind is not None:
            found.append(Removable(kind, folder, _size(folder)))
    return found


def remove(work: Path, outputs: Sequence[Removable]) -> None:
    """Remove outputs from the store in `work`. Raises InputError while a run uses the store."""
    with unused(work):
        for each in outputs:
            if each.folder.is_dir() and not each.folder.is_symlink():
                shutil.rmtree(each.folder)
            else:
                each.folder.unlink()


def _kind(folder: Path, named: set[tuple[str, str]]) -> str | None:
    name, ending = folder.stem, folder.suffix
    if not is_fingerprint(name):
        return None
    if ending in (PARTIAL, DAMAGED):
        return ending.removeprefix(".")
    if ending or not named or (folder.parent.name, name) in named:
        return None
    # Learnt objects also lie in `work`; no manifest names them, and they are no stage's output.
    return "unreferenced" if (folder / RECORD).is_file() else None


def _referred_to(results: Iterable[Path]) -> Iterator[tuple[str, str]]:
    """Stage and fingerprint of every output that a manifest names."""
    for path in (found for folder in results for found in sorted(folder.rglob(MANIFEST))):
        stages = read_manifest(path).get("stages", [])
        try:
            yield from ((str(each["stage"]), str(each["fingerprint"])) for each in stages)
        except (TypeError, KeyError) as error:
            raise DataError(f"{path} is damaged: stages are {stages!r}") from error


def _size(folder: Path) -> int:
    files = [folder] if folder.is_file() else folder.rglob("*")
    return sum(path.lstat().st_size for path in files if path.is_file())
