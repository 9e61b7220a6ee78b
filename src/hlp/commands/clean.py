"""`hlp clean`: lists what may go from the folder of stages, and removes it if told to."""

from collections.abc import Sequence
from pathlib import Path

from hlp.commands import composing
from hlp.errors import HlpError, InputError

_KEYS = ("work", "outputs", "kinds", "dry")


def command(arguments: Sequence[str]) -> None:
    """List, or remove with dry=false; exits with 2 if the arguments are wrong."""
    given = composing.key_values(arguments, _KEYS, CLEAN_HELP, switches=("dry",))
    if given is None:
        return
    try:
        _clean(
            Path(given.get("work", "work")).expanduser(),
            [Path(each).expanduser() for each in _names(given.get("outputs", "outputs"))],
            _names(given["kinds"]) if "kinds" in given else None,
            dry=given.get("dry", "true") == "true",
        )
    except HlpError as error:
        composing.fail(error)


def _clean(work: Path, outputs: Sequence[Path], kinds: Sequence[str] | None, dry: bool) -> None:
    from hlp.stages.cleaning import KINDS, find_removable, remove

    for kind in kinds or ():
        if kind not in KINDS:
            raise InputError(f"kinds={kind}: choose from {', '.join(KINDS)}")
    found = [each for each in find_removable(work, outputs) if each.kind in (kinds or KINDS)]
    for each in found:
        print(f"{each.kind:<12}  {_megabytes(each.size)}  {each.folder}")
    total = _megabytes(sum(each.size for each in found)).strip()
    if dry:
        print(f"{len(found)} outputs, {total}. Nothing was removed: dry=false removes them.")
        return
    remove(work, found)
    print(f"{len(found)} outputs removed, {total}.")


def _names(value: str) -> list[str]:
    return [each.strip() for each in value.strip("[]").split(",") if each.strip()]


def _megabytes(size: int) -> str:
    return f"{size / 1e6:9.1f} MB"


CLEAN_HELP = """\
usage: hlp clean [dry=false] [work=DIR] [outputs=DIR,…] [kinds=KIND,…]

Lists outputs of stages that may go, with their sizes:

  partial        begun by a run that crashed or was stopped; the same run would
                 continue them
  damaged        changed after they were made; set aside, and made again when
                 they were needed
  unreferenced   finished, but named by no manifest.json below outputs. Runs
                 that were stopped write none: what they have finished is listed
                 too

  dry       true: only list them (default); false: remove them
  work      folder of the stages (default: work)
  outputs   folders with the results of finished runs (default: outputs)
  kinds     only these kinds

Objects that `hlp learn` and `hlp predict` have learnt are not listed: see
`hlp objects`. Nothing is removed while a run uses the folder. Without any
manifest, nothing is unreferenced. Everything that is removed is made again when
a run needs it.

hlp clean                                    what may go
hlp clean kinds=partial,damaged dry=false    remove what no run can use as it is"""
