import shutil
from pathlib import Path

import pytest

from hlp.errors import InputError
from hlp.method.learn.learnt_folder import LearntRecord, write_record
from hlp.method.learn.unfinished_folder import (
    SCORED,
    finish,
    folder_in_the_making,
    once,
    restore_replaced,
)
from hlp.method.settings import MethodSettings
from hlp.runs.learnt_cache import find_learnt

NAMES = ("codebook.npz", "sub/weights", ".done.json")


def make(folder: Path, marker: str = ".done.json") -> bool:
    """Make the content unless it is there; whether it was made."""
    with once(folder, marker) as missing:
        if missing:
            (folder / "sub").mkdir(exist_ok=True)
            (folder / "codebook.npz").write_bytes(b"features")
            (folder / "sub" / "weights").write_bytes(b"numbers")
    return missing


def test_content_is_made_once(tmp_path: Path) -> None:
    assert make(tmp_path / "object")
    assert not make(tmp_path / "object")
    assert make(tmp_path / "object", SCORED)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("content", [b"", b"numbres", b"[" * 100_000, None])
def test_damaged_content_is_made_again(tmp_path: Path, name: str, content: bytes | None) -> None:
    make(tmp_path / "object")
    path = tmp_path / "object" / name
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content)
    assert make(tmp_path / "object")
    assert (tmp_path / "object" / "sub" / "weights").read_bytes() == b"numbers"
    assert not make(tmp_path / "object")


def test_an_error_marks_nothing_as_made(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), once(tmp_path / "object"):
        (tmp_path / "object" / "codebook.npz").write_bytes(b"half")
        raise ZeroDivisionError
    assert make(tmp_path / "object")


def replace_folder(folder: Path, content: bytes) -> None:
    """Replace a learnt folder, as adding objects does."""
    with folder_in_the_making(folder, {"made_from": "x"}, replaces=True) as partial:
        (partial / "weights").write_bytes(content)
        finish(partial, LearntRecord({"bolt": 1}, (1,), MethodSettings()))


@pytest.fixture
def killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A learnt folder whose replacing was killed between the two renames."""
    folder = tmp_path / "learnt"
    folder.mkdir()
    (folder / "weights").write_bytes(b"old")
    write_record(folder, LearntRecord({"bolt": 1}, (1,), MethodSettings()))
    rename = Path.rename

    def stop_at_the_second(path: Path, target: Path) -> Path:
        if path.suffix == ".partial":
            raise KeyboardInterrupt
        return rename(path, target)

    with monkeypatch.context() as context, pytest.raises(KeyboardInterrupt):
        context.setattr(Path, "rename", stop_at_the_second)
        replace_folder(folder, b"new")
    assert not folder.exists()
    return folder


def test_a_folder_that_a_killed_process_had_renamed_comes_back(killed: Path) -> None:
    restore_replaced(killed)
    assert (killed / "weights").read_bytes() == b"old"
    assert {each.name for each in killed.parent.iterdir() if each.is_dir()} == {
        "learnt", "learnt.partial",
    }  # fmt: skip
    replace_folder(killed, b"newer")
    assert (killed / "weights").read_bytes() == b"newer"
    assert [each.name for each in killed.parent.iterdir() if each.is_dir()] == ["learnt"]


def test_it_also_comes_back_when_it_is_looked_for(killed: Path, tmp_path: Path) -> None:
    assert find_learnt("learnt", tmp_path) == killed
    assert (killed / "weights").read_bytes() == b"old"


def test_what_the_user_took_away_does_not_come_back(killed: Path) -> None:
    shutil.rmtree(killed.with_name("learnt.partial"))
    restore_replaced(killed)
    assert not killed.exists()


def test_a_folder_is_not_brought_back_while_it_is_being_replaced(killed: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    with killed.with_name(".learnt.lock").open("w") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another process"):
            restore_replaced(killed)
    assert not killed.exists()


def test_a_lock_that_is_a_link_empties_nobodys_file(tmp_path: Path) -> None:
    """A folder from somebody else may bring one, with what makes a reader bring it back."""
    mine = tmp_path / "mine.txt"
    mine.write_text("of the user")
    (tmp_path / "L.partial").mkdir()
    (tmp_path / "L.partial" / ".request.json").write_text("{}")
    hidden = tmp_path / ".L.abc" / "L"
    hidden.mkdir(parents=True)
    (hidden / "learnt.json").write_text("{}")
    (tmp_path / ".L.lock").symlink_to(mine)
    with pytest.raises(InputError, match=r"\.L\.lock is a link"):
        find_learnt(str(tmp_path / "L"), tmp_path / "cache")
    refused = pytest.raises(InputError, match=r"\.L\.lock is a link")
    with refused, folder_in_the_making(tmp_path / "L", {}):
        pass
    assert mine.read_text() == "of the user"
