"""What may go from a store: partial outputs of crashed runs, damaged ones, unreferenced ones."""

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlp.errors import MissingFileError
from hlp.files import MANIFEST, locked
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
    # Runs that are about to begin wait until this is done.
    with locked(work / IN_USE, f"a run is using {work}: wait until it has ended"):
        for output in outputs:
            if output.folder.is_dir() and not output.folder.is_symlink():
                shutil.rmtree(output.folder)
            else:
                output.folder.unlink()
