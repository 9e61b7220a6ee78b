"""`hlp notebooks` and `hlp clean`: what they copy, remove and refuse."""

from pathlib import Path

import nbformat
import pytest

from hlp import files
from hlp.cli import main

NAMES = ["01_method.ipynb", "02_runs.ipynb", "03_own_object.ipynb", "04_ablations.ipynb"]
Out = pytest.CaptureFixture[str]


def test_notebooks_are_copied_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["notebooks"])
    assert capsys.readouterr().out.splitlines() == [f"notebooks/{name}" for name in NAMES]
    for name in NAMES:
        nbformat.validate(nbformat.read(tmp_path / "notebooks" / name, as_version=4))


def test_they_are_copied_into_a_folder_of_ones_own_and_can_be_written(tmp_path: Path) -> None:
    main(["notebooks", f"output={tmp_path}/deep/own"])
    copies = sorted((tmp_path / "deep" / "own").iterdir())
    assert [path.name for path in copies] == NAMES
    copies[0].write_text("mine")


def fails(words: list[str], capsys: Out) -> str:
    """The one line that the command says when it fails."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_none_is_copied_where_one_is_there(tmp_path: Path, capsys: Out) -> None:
    mine = tmp_path / NAMES[2]
    mine.write_text("mine")
    assert f"{mine} exists already" in fails(["notebooks", f"output={tmp_path}"], capsys)
    assert [path.name for path in tmp_path.iterdir()] == [mine.name]
    assert mine.read_text() == "mine"


def test_a_folder_that_cannot_be_made_or_is_not_shipped_is_one_line(
    tmp_path: Path, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    fails(["notebooks", f"output={tmp_path}/file"], capsys)
    monkeypatch.setattr(files, "__file__", str(tmp_path / "lib" / "hlp" / "files.py"))
    assert "reinstall hlp" in fails(["notebooks", f"output={tmp_path}"], capsys)


def test_clean_lists_and_removes_only_if_asked_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    """What a crashed run left lies in the folder."""
    monkeypatch.chdir(tmp_path)
    partial = tmp_path / "work" / "views" / f"{'a' * 16}.partial"
    partial.mkdir(parents=True)
    (partial / "half").write_bytes(bytes(2_000_000))
    main(["clean"])
    listed = capsys.readouterr().out
    assert listed.split()[:3] == ["partial", "2.0", "MB"]
    assert "1 outputs, 2.0 MB. Nothing was removed" in listed and partial.exists()
    main(["clean", "dry=false", "kinds=damaged"])
    assert partial.exists()
    assert "kinds=whole: choose from" in fails(["clean", "kinds=whole"], capsys)
    assert "there is no folder nowhere" in fails(["clean", "work=nowhere"], capsys)
    main(["clean", "dry=false", "kinds=[partial,damaged]"])
    assert capsys.readouterr().out.endswith("1 outputs removed, 2.0 MB.\n")
    assert not partial.exists()
