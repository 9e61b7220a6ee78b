"""Files of a folder of learnt objects are damaged: each command says which, in one line."""

import shutil
from pathlib import Path

import pytest

from damage import damage
from forked_hlp import run_hlp
from frame_files import write_flat

pytestmark = pytest.mark.slow

FRAMES = ("rgb=rgb", "depth=depth", "intrinsics=[60,60,31.5,23.5]", "depth_scale=1")


@pytest.fixture
def copy(learnt, tmp_path):
    return Path(shutil.copytree(learnt, tmp_path / "learnt"))


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", ["learnt.json", "classifier/classifier.onnx"])
def test_no_command_uses_damaged_objects(copy, name):
    damage([copy / name], "flipped")
    for number in range(2):  # several, so that a frame that fails would cost itself alone
        write_flat(copy.parent, f"{number}.png", 90, 700, (48, 64))
    commands = (
        ("live", "source=folder", "learnt=learnt", "idle_s=1", *FRAMES),
        ("objects", "register", "learnt", "model", "uri=sqlite:///mlflow.db"),
        ("objects", "export", "learnt", "copy"),
        ("predict", "learnt=learnt", "output=out", *FRAMES),
    )
    if name == "learnt.json":
        commands += (("objects", "show", "learnt"),)
    for command in commands:
        ended = run_hlp(copy.parent, *command)
        assert ended.returncode == 1, command
        assert ended.stderr.startswith("hlp: "), (command, ended.stderr)
        assert str(Path("learnt", name)) in ended.stderr, (command, ended.stderr)
        assert ended.stderr.count("\n") == 1, command
