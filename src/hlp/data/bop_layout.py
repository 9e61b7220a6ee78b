"""What a BOP folder holds: its split of test images and its list of targets."""

from pathlib import Path

from hlp.data.bop_scenes import list_scenes
from hlp.errors import MissingFileError

AUTO = "auto"
"""The value of a setting that is to be found in the folder."""
_KINDS = ("test", "val")


def find_split(root: Path) -> str:
    """The folder with the images to evaluate: `test`, `test_*`, `val` or `val_*`.

    The first with true poses, or the first at all if none has them: BOP keeps the true poses of
    some of its test images private. Raises MissingFileError if there is no such folder.
    """
    found = [
        folder.name
        for kind in _KINDS
        for folder in sorted(root.glob(f"{kind}*"))
        if folder.is_dir() and folder.name.partition("_")[0] == kind
    ]
    if not found:
        raise MissingFileError(f"{root} has no folder test, test_* or val: set data.split=NAME")
    scenes = {name: list_scenes(root / name).values() for name in found}
    with_poses = [name for name in found if any(each.annotated for each in scenes[name])]
    return (with_poses or found)[0]


def find_targets_file(root: Path, split: str) -> str | None:
    """BOP's list of targets for a split, if there is one.

    The list of 2019 states the objects and their numbers, that of 2024 only the frames.
    """
    kind = split.partition("_")[0]
    names = [f"{kind}_targets_bop{year}.json" for year in (19, 24)]
    return next((name for name in names if (root / name).is_file()), None)
