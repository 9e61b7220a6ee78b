"""What is opened in a folder lies in it, whoever made the folder."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from hlp.errors import DataError, InputError
from hlp.folders import found_below, inside, lock_file, locked, own_files

LEAVES: dict[str, Callable[[Path, Path], None]] = {
    "link to a file": lambda path, secret: path.symlink_to(secret),
    "link upwards": lambda path, secret: path.symlink_to(Path("../../secret.txt")),
    "link to a folder": lambda path, secret: path.symlink_to(secret.parent),
    "link to nowhere": lambda path, secret: path.symlink_to(secret.parent / "new"),
    "link to a link": lambda path, secret: (
        path.with_name("first").symlink_to(secret), path.symlink_to("first"),
    )[1],
    "pipe": lambda path, secret: os.mkfifo(path),
    "deep": lambda path, secret: Path(path, *["d"] * 70).mkdir(parents=True),
}  # fmt: skip


@pytest.mark.parametrize("what", LEAVES)
def test_what_leads_out_of_a_folder_is_named(tmp_path, what, caplog):
    (tmp_path / "secret.txt").write_text("of the user")
    sub = tmp_path / "run" / "sub"
    sub.mkdir(parents=True)
    (sub / "summary.json").touch()
    LEAVES[what](sub / "odd", tmp_path / "secret.txt")
    words = {"pipe": "neither a file", "deep": "below 64 folders"}.get(what, "leads out of")
    with pytest.raises(DataError, match=words):
        own_files(tmp_path / "run")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "summary.json").touch()
    assert found_below(tmp_path, "summary.json") == [tmp_path / "other" / "summary.json"]
    assert f"left out: {sub}" in caplog.text


def test_a_folder_of_ones_own_passes_and_may_be_a_link(tmp_path):
    sub = tmp_path / "run" / "sub"
    sub.mkdir(parents=True)
    (sub / "file").touch()
    (tmp_path / "run" / "again").symlink_to("sub/file")
    (tmp_path / "run" / "folder").symlink_to("sub")
    (tmp_path / "link").symlink_to(tmp_path / "run")
    (tmp_path / "run" / "loop").symlink_to("loop")
    for folder in (tmp_path / "run", tmp_path / "link"):
        assert {*own_files(folder)} == {folder / "sub" / "file", folder / "again"}
    assert found_below(tmp_path, "file") == [sub / "file"]
    assert own_files(tmp_path / "absent") == found_below(tmp_path / "absent", "file") == []


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/../../b", ".."])
def test_names_lead_nowhere_else(tmp_path, name):
    assert inside(tmp_path, "a/b") == tmp_path / "a" / "b"
    with pytest.raises(DataError, match="outside"):
        inside(tmp_path, name)


def test_a_lock_neither_follows_a_link_nor_waits_for_a_pipe(tmp_path):
    mine = tmp_path / "mine.txt"
    mine.write_text("of the user")
    (tmp_path / "link").symlink_to(mine)
    (tmp_path / "new").symlink_to(tmp_path / "made")
    for name in ("link", "new"):
        with pytest.raises(InputError, match="is a link, which no lock is"):
            lock_file(tmp_path / name)
    assert mine.read_text() == "of the user" and not (tmp_path / "made").exists()
    (tmp_path / "folder" / "full").mkdir(parents=True)
    lock_file(tmp_path / "folder").close()
    assert (tmp_path / "folder").is_file() and [*tmp_path.glob("folder.*/full")]
    os.mkfifo(tmp_path / "pipe")
    taken = pytest.raises(InputError, match="taken")
    with locked(tmp_path / "pipe", ""), taken, locked(tmp_path / "pipe", "taken"):
        pass
