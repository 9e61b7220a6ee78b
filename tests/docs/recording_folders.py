"""Folders that stand for the recordings that the pages' commands name; noise, not scenes."""

import shutil
from pathlib import Path

import yaml
from markdown_pages import ROOT

from bop_folder import write_models, write_scene, write_targets

ALL_OBJECTS = tuple(yaml.safe_load((ROOT / "conf/data/objects/linemod.yaml").read_text()))
"""LINEMOD's, by name."""

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


def left_out(words: list[str]) -> list[str]:
    """What takes all but ape and cat from a command that learns LINEMOD's objects."""
    given = {word.removeprefix("~data.objects.") for word in words}
    return [f"~data.objects.{name}" for name in ALL_OBJECTS if name not in {*_LEARNT, *given}]
