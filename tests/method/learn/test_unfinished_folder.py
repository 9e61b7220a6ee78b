"""The record of a folder of learnt objects, and a folder in the making."""

import json
import shutil
from pathlib import Path

import pytest

from hlp.errors import DataError, InputError, MissingFileError
from hlp.fingerprints import sealed
from hlp.method.learn.learnt_folder import LearntRecord, read_record, write_record
from hlp.method.learn.unfinished_folder import finish, folder_in_the_making, once, restore_replaced
from hlp.method.opened_folder import OpenedFolder
from hlp.method.settings import MethodSettings
from hlp.runs.learnt_cache import find_learnt

RECORD = LearntRecord({"bear": 1, "can": 4}, (1, 3, 4), MethodSettings(), {"a/b": "0"})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"objects": {"bear": 1.5}}, "objects.bear is 1.5: it must be a whole number"),
        ({"classes": {}}, "classes is {}: it must be a list"),
        ({"files": {"a": None}}, "files.a is null: it must be text"),
        ({"settings": {"seed": "0"}}, "settings.seed is '0': it must be a whole number"),
        ({"classes": [1, 1, 4]}, "ids [1, 4], classes [1, 1, 4]: each has one"),
        ({"objects": {}}, "ids [], classes [1, 3, 4]: each has one"),
    ],
)
def test_a_record_comes_back_and_what_is_not_as_its_schema_is_named(tmp_path, values, words):
    write_record(tmp_path, RECORD)
    assert read_record(tmp_path) == RECORD
    path = tmp_path / "learnt.json"
    content = json.loads(path.read_text()) | values
    del content["checksum"]
    path.write_text(json.dumps(sealed(content)))
    with pytest.raises(DataError) as caught:
        read_record(tmp_path)
    assert f"{path}: {words}" in str(caught.value)


def make(folder):
    """Make the content unless it is there; whether it was made."""
    made = []

    def write(folder):
        made.append(folder)
        (folder / "sub").mkdir(exist_ok=True)
        (folder / "codebook.npz").write_bytes(b"features")
        (folder / "sub" / "weights").write_bytes(b"numbers")

    once(folder, write)
    return bool(made)


@pytest.mark.parametrize("name", ["codebook.npz", "sub/weights", ".done.json"])
@pytest.mark.parametrize("content", [b"", b"numbres", b"[" * 100_000, None])
def test_content_is_made_once_unless_it_is_damaged(tmp_path, name, content):
    folder = tmp_path / "object"
    with pytest.raises(ZeroDivisionError):
        once(folder, lambda _: 1 / 0)
    assert make(folder) and not make(folder)
    if content is None:
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(content)
    assert make(folder) and not make(folder)
    assert (folder / "sub" / "weights").read_bytes() == b"numbers"


def replace_folder(folder, content):
    """Replace a learnt folder, as adding objects does."""
    with folder_in_the_making(folder, {"made_from": "x"}, replaces=True) as partial:
        (partial / "weights").write_bytes(content)
        finish(partial, LearntRecord({"bolt": 1}, (1,), MethodSettings()))


@pytest.fixture
def killed(tmp_path, monkeypatch):
    """A learnt folder whose replacing was killed between the two renames."""
    folder = tmp_path / "learnt"
    folder.mkdir()
    (folder / "weights").write_bytes(b"old")
    write_record(folder, LearntRecord({"bolt": 1}, (1,), MethodSettings()))
    rename = Path.rename

    def stop_at_the_second(path, target):
        if path.suffix == ".partial":
            raise KeyboardInterrupt
        return rename(path, target)

    with monkeypatch.context() as context, pytest.raises(KeyboardInterrupt):
        context.setattr(Path, "rename", stop_at_the_second)
        replace_folder(folder, b"new")
    assert not folder.exists()
    return folder


def folders_beside(folder):
    return {path.name for path in folder.parent.iterdir() if path.is_dir()}


def test_a_folder_that_a_killed_process_had_renamed_comes_back(killed, tmp_path):
    """But not while another process is replacing it, nor once the user took it away."""
    fcntl = pytest.importorskip("fcntl")
    with killed.with_name(".learnt.lock").open("w") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another process"):
            restore_replaced(killed)
    assert not killed.exists()
    assert find_learnt("learnt", tmp_path) == killed
    assert (killed / "weights").read_bytes() == b"old"
    assert folders_beside(killed) == {"learnt", "learnt.partial"}
    replace_folder(killed, b"newer")
    assert (killed / "weights").read_bytes() == b"newer"
    assert folders_beside(killed) == {"learnt"}
    shutil.rmtree(killed)
    restore_replaced(killed)
    assert not killed.exists()


def test_what_is_only_read_is_not_repaired_and_what_is_a_link_is_not_followed(tmp_path):
    """A folder from somebody else may bring all that asks for a repair."""
    mine = tmp_path / "mine.txt"
    mine.write_text("of the user")
    (tmp_path / "L.partial").mkdir()
    (tmp_path / "L.partial" / ".request.json").write_text("{}")
    hidden = tmp_path / ".L.replaced"
    hidden.mkdir(parents=True)
    (hidden / "learnt.json").write_text("{}")
    (tmp_path / ".L.lock").symlink_to(mine)
    with pytest.raises(MissingFileError, match="neither a folder"):
        find_learnt(str(tmp_path / "L"), tmp_path / "cache")
    with pytest.raises(MissingFileError, match=rf"killed.*Rename {hidden}"):
        OpenedFolder.load(tmp_path / "L")
    assert hidden.is_dir()
    refused = pytest.raises(InputError, match=r"\.L\.lock is a link")
    with refused, folder_in_the_making(tmp_path / "L", {}):
        pass
    assert mine.read_text() == "of the user"
    (tmp_path / "M.partial").symlink_to(tmp_path / "L.partial")
    with pytest.raises(InputError, match="in the way"), folder_in_the_making(tmp_path / "M", {}):
        pass
    assert (tmp_path / "L.partial" / ".request.json").read_text() == "{}"
