"""`hlp download`, `notebooks` and `clean`: fill folders of the user's, and empty the stages'."""

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlp.commands.arguments import is_true, known_arguments, text_list
from hlp.data.public_sets import IMAGES, SETS, find_set
from hlp.errors import InputError, MissingFileError
from hlp.files import MANIFEST, expanded, shipped_folder
from hlp.folders import locked, own_files
from hlp.stages.manifest import is_fingerprint, named_outputs
from hlp.stages.store import DAMAGED, IN_USE, PARTIAL, RECORD

KINDS = ("partial", "damaged", "unreferenced")


@dataclass(frozen=True)
class Removable:
    """An output that can be removed: `kind` is one of `KINDS`, `size` in bytes."""

    kind: str
    folder: Path
    size: int


def find_removable(work: Path, results: Iterable[Path]) -> list[Removable]:
    """What can be removed from the store in `work`.

    An output is unreferenced if no manifest below the folders of `results` names it. Without any
    manifest none is. Raises MissingFileError if there is no store, DataError for a broken manifest.
    """
    if not work.is_dir():
        raise MissingFileError(f"there is no folder {work}: name the one of the runs, work=DIR")
    # Here none is left out with a warning: what it names would count as unreferenced.
    written = (path for folder in results for path in own_files(folder))
    manifests = [path for path in written if path.name == MANIFEST]
    outputs = (output for path in manifests for output in named_outputs(path))
    named = {(output.stage, output.fingerprint) for output in outputs}
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


def download(arguments: Sequence[str]) -> None:
    """Load a data set and say what to do with it."""
    from hlp.data.download import download as load  # the help needs no network's library

    name, *rest = arguments
    if "=" in name:
        raise InputError(f"'{name}': the name of a data set comes first: hlp download NAME …")
    public = find_set(name)
    given = known_arguments(rest, ("output", "images", "mirror"), "download")
    images = given.get("images", next(iter(public.archives)))
    folder = expanded(given.get("output", f"data/{name}"))
    mirror = given.get("mirror")
    print(public.what)
    print(f"licence   {public.licence or 'not known to HLP'}; see {public.page}")
    load(public, folder, images, mirror)
    print(f"Next: {public.next_step.format(folder=folder)}")


def filled(text: str) -> str:
    """The help with the data sets that there are."""
    sets = "\n".join(
        f"  {public.name:<8} {public.what}\n"
        f"{'':11}licence: {public.licence or 'not known here, see its page'}"
        for public in SETS.values()
    )
    servers = {name: SETS[name].base for name in ("lm", "voc2012")}
    return text.format(sets=sets, images="|".join(IMAGES), **servers)


def notebooks(arguments: Sequence[str]) -> None:
    """Copy the tutorial notebooks into a folder, none of them if one exists already."""
    given = known_arguments(arguments, ("output",), "notebooks")
    folder = expanded(given.get("output", "notebooks"))
    sources = sorted(shipped_folder("notebooks").glob("*.ipynb"))
    targets = [folder / source.name for source in sources]
    for target in targets:
        if target.exists():
            raise InputError(f"{target} exists already: choose another folder with output=DIR")
    folder.mkdir(parents=True, exist_ok=True)
    for source, target in zip(sources, targets, strict=True):
        print(shutil.copyfile(source, target))


def clean(arguments: Sequence[str]) -> None:
    """List the stage outputs that can be removed; with dry=false, remove them."""
    given = known_arguments(arguments, ("work", "outputs", "kinds", "dry"), "clean")
    kinds = text_list(given["kinds"]) if "kinds" in given else KINDS
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"kinds={kind}: choose from {', '.join(KINDS)}")
    work, dry = expanded(given.get("work", "work")), is_true(given, "dry", True)
    outputs = [expanded(name) for name in text_list(given.get("outputs", "outputs"))]
    found = [output for output in find_removable(work, outputs) if output.kind in kinds]
    for output in found:
        print(f"{output.kind:<12}  {output.size / 1e6:9.1f} MB  {output.folder}")
    total = f"{sum(output.size for output in found) / 1e6:.1f} MB"
    if dry:
        print(f"{len(found)} outputs, {total}. Nothing was removed: dry=false removes them.")
        return
    remove(work, found)
    print(f"{len(found)} outputs removed, {total}.")
