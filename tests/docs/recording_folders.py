"""Folders that stand for the recordings that the pages' commands name; noise, not scenes."""

import shutil
from pathlib import Path

from bop_folder import write_models, write_scene, write_targets

_LEARNT = ("ape", "cat")


def write_recordings(folder: Path, photographs: Path, room: Path) -> None:
    """LINEMOD's board and the recordings of experiment=recordings, two frames of noise each.

    Beside them stand photographs, rooms and scenes of Doumanoglou et al., copied from two folders.
    """
    shutil.copytree(photographs, folder / "photos")
    shutil.copytree(room, folder / "rooms")
    shutil.copytree(room, folder / "icbin" / "frames")
    for name in ("lm", "cup", "mustard", "ycbv"):
        ids = (1, 6)
        write_models(folder / name / "models", ids)
        write_scene(folder / name / "test")
        targets = [(6, 0, 1, 1), (6, 0, 6, 2), (6, 12, 1, 1)]
        write_targets(folder / name / "test_targets_bop19.json", targets)


ONLY = f"data.only=[{','.join(_LEARNT)}]"
"""Of LINEMOD's objects those that are there."""
