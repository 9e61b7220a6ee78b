"""`hlp notebooks`: what it copies, and what it refuses."""

from pathlib import Path

import nbformat
import pytest

from hlp.cli import main
from hlp.commands import notebooks

NAMES = ["01_method.ipynb", "02_runs.ipynb", "03_own_object.ipynb", "04_ablations.ipynb"]
Out = pytest.CaptureFixture[str]


def test_all_are_copied_and_named(
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


def test_none_is_copied_where_one_is_there(tmp_path: Path, capsys: Out) -> None:
    mine = tmp_path / NAMES[2]
    mine.write_text("mine")
    with pytest.raises(SystemExit) as ended:
        main(["notebooks", f"output={tmp_path}"])
    assert ended.value.code == 1
    assert f"{mine} is there already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [mine.name]
    assert mine.read_text() == "mine"


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path, capsys: Out) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as ended:
        main(["notebooks", f"output={tmp_path}/file"])
    assert ended.value.code == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_other_arguments_are_refused(capsys: Out) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["notebooks", "folder=here"])
    assert ended.value.code == 2
    assert "cannot use 'folder=here'" in capsys.readouterr().err


def test_a_package_without_them_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebooks.hlp, "__file__", str(tmp_path / "lib" / "hlp" / "__init__.py"))
    with pytest.raises(FileNotFoundError, match="reinstall hlp"):
        notebooks.notebooks_folder()


def test_help_names_each_of_them() -> None:
    for name in NAMES:
        assert f"  {name.removesuffix('.ipynb')} " in notebooks.NOTEBOOKS_HELP
