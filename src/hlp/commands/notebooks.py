"""`hlp notebooks`: copies the notebooks that teach into a folder of the user's own."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import hlp
from hlp.commands import composing
from hlp.errors import HlpError, InputError, MissingFileError, is_expected

_FOLDER = "notebooks"


def command(arguments: Sequence[str]) -> None:
    """Copy the notebooks; exits with 1 if one is there, with 2 if the arguments are wrong."""
    given = composing.key_values(arguments, ("output",), NOTEBOOKS_HELP)
    if given is None:
        return
    try:
        for path in copy_notebooks(Path(given.get("output", _FOLDER)).expanduser()):
            print(path)
    except (HlpError, OSError) as error:
        if not is_expected(error):
            raise
        composing.fail(error)


def copy_notebooks(folder: Path) -> list[Path]:
    """Copy all notebooks into a folder, which is made; where they lie then.

    Raises InputError, and copies none, if one of them is there already.
    """
    sources = sorted(notebooks_folder().glob("*.ipynb"))
    copies = [folder / source.name for source in sources]
    for copy in copies:
        if copy.exists():
            raise InputError(f"{copy} is there already: choose another folder with output=DIR")
    folder.mkdir(parents=True, exist_ok=True)
    for source, copy in zip(sources, copies, strict=True):
        shutil.copyfile(source, copy)
    return copies


def notebooks_folder() -> Path:
    """Folder of the notebooks: inside an installed package, or the checkout's own.

    Raises MissingFileError where there is none.
    """
    package = Path(hlp.__file__).parent
    folders = (package / _FOLDER, package.parents[1] / _FOLDER)
    for folder in folders:
        if folder.is_dir():
            return folder
    raise MissingFileError(f"no folder {' or '.join(map(str, folders))}: reinstall hlp")


NOTEBOOKS_HELP = """\
usage: hlp notebooks [output=DIR]

Copies the notebooks that come with HLP:

  01_method       what each stage sees, on one frame of the demo
  02_runs         tables and figures of finished runs, and the runs in MLflow
  03_own_object   learn your own object and find it, by the Python API
  04_ablations    Figure 9 of the paper, and a sweep of your own

  output   folder for them, which is made (default: notebooks)

Nothing is overwritten. They expect work/ and outputs/ of `hlp run` beside their
folder; the first cell of each says so and can be changed. An editor that shows
them needs a kernel: pip install 'hlp[notebooks]'

hlp notebooks                 into notebooks/
hlp notebooks output=~/hlp    into a folder of your choice"""
