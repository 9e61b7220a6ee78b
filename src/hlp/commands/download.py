"""`hlp download`: public data sets, in a form that HLP reads."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.commands import composing, own_arguments
from hlp.data.public.sets import IMAGES, SETS, find_set
from hlp.errors import InputError

if TYPE_CHECKING:
    from hlp.data.public.sets import PublicSet

_KEYS = ("output", "images", "mirror")
_INDENT = " " * 11


def command(arguments: Sequence[str]) -> None:
    """Load a data set and say what to do with it."""
    if not arguments or composing.HELP & set(arguments):
        print(DOWNLOAD_HELP)
        return
    own_arguments.call(lambda: _download(arguments))


def _download(arguments: Sequence[str]) -> None:
    name, *rest = arguments
    if "=" in name:
        raise InputError(f"'{name}': the name of a data set comes first: hlp download NAME …")
    public = find_set(name)
    given = own_arguments.split_arguments(rest)
    own_arguments.check_known(given, _KEYS, "download")
    images = given.get("images", next(iter(public.archives)))
    folder = Path(given.get("output", f"data/{name}")).expanduser()
    mirror = given.get("mirror")
    print(_described(public, images, mirror))
    from hlp.data.public.download import download

    download(public, folder, images, mirror)
    print(f"Next: {public.next_step.format(folder=folder)}")


def _described(public: PublicSet, images: str, mirror: str | None) -> str:
    files = public.files(images, mirror)
    lines = [
        public.what,
        f"licence   {public.licence or 'not known to HLP'}; see {public.page}",
        *(f"source    {each.url}" for each in files),
    ]
    return "\n".join(lines)


def _listed() -> str:
    lines = []
    for public in SETS.values():
        sizes = ", ".join(f"{size} ({images})" for images, size in public.sizes.items())
        licence = public.licence or "not known here, see its page"
        about = f"{sizes or 'size: see the server'}; licence: {licence}"
        lines += [f"  {public.name:<8} {public.what}"]
        lines += textwrap.wrap(about, 80, initial_indent=_INDENT, subsequent_indent=_INDENT)
    return "\n".join(lines)


DOWNLOAD_HELP = f"""\
usage: hlp download NAME [output=FOLDER] [images={"|".join(IMAGES)}] [mirror=URL]

Loads a public data set: models and test images in BOP's layout, or photographs.

{_listed()}

  output   a new folder (default: data/NAME)
  images   test images: those of BOP's challenges (bop19, the default), or all
  mirror   another server in place of {SETS["lm"].base}
           (voc2012: {SETS["voc2012"].base})

Source and licence are said first. After a cut or Ctrl-C, the same command
continues. Files are compared with known checksums, or those that the server
states, and unpacked only if they are whole and nothing in them leads out of the
folder. The folder appears when all is there; until then it needs room for the
archives and what is in them, in .NAME.partial beside it.

hlp download lmo                     then: hlp run data=bop data.root=data/lmo
hlp download ycbv images=all output=/data/ycbv"""
