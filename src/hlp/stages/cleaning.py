"""What may go from a store: partial outputs of crashed runs, damaged ones, unreferenced ones."""

import fcntl
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from hlp.errors import InputError, MissingFileError
from hlp.files import MANIFEST
from hlp.stages.manifest import is_fingerprint, named_outputs
from hlp.stages.store import DAMAGED, IN_USE, PARTIAL, RECORD

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
    manifests = [path for folder in results for path in sorted(folder.rglob(MANIFEST))]
    named = {(stage, name) for path in manifests for stage, _, name in named_outputs(path)}
    found = []
    for folder in sorted(work.glob("*/*")):
        kind = _kind(folder, named)
        if kind is not None:
            files = [folder] if folder.is_file() else folder.rglob("*")
            size = sum(path.lstat().st_size for path in files if path.is_file())
            found.append(Removable(kind, folder, size))
    return found


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


def remove(work: Path, outputs: Sequence[Removable]) -> None:
    """Remove outputs from the store in `work`. Raises InputError while a run uses the store."""
    with _unused(work):
        for output in outputs:
            if output.folder.is_dir() and not output.folder.is_symlink():
                shutil.rmtree(output.folder)
            else:
                output.folder.unlink()


@contextmanager
def _unused(work: Path) -> Iterator[None]:
    """Keep runs from beginning to use a store. Raises InputError while one uses it."""
    with (work / IN_USE).open("ab") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(f"a run is using {work}: wait until it has ended") from error
        yield
