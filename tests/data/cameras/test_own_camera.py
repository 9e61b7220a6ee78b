"""Cameras in a user's own file."""

from pathlib import Path

import pytest

from hlp.data.cameras.camera import load_camera
from hlp.errors import InputError, MissingFileError

OWN = """
import numpy as np
from hlp import CameraImage

class Mine:
    def __iter__(self):
        yield CameraImage(np.zeros((4, 6, 3), np.uint8), np.ones((4, 6)), np.eye(3), "one")
    def close(self):
        self.closed = True

def frames():
    yield from Mine()

class NoCamera:
    pass
"""


def test_a_class_or_a_generator_is_a_camera(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(OWN)
    for name in ("Mine", "frames"):
        camera = load_camera(f"{path}:{name}")
        assert [each.name for each in camera] == ["one"]
        camera.close()


def test_what_is_no_camera_is_named(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(OWN)
    for name, words in (("Other", "no class or function Other"), ("NoCamera", "no __iter__")):
        with pytest.raises(InputError, match=words):
            load_camera(f"{path}:{name}")
    with pytest.raises(MissingFileError, match=r"there is no file .*none\.py"):
        load_camera(f"{tmp_path / 'none.py'}:Mine")
