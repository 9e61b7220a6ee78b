import pytest

from hlp.cli import main
from hlp.commands.tracking_uri import tracking_uri
from hlp.commands.ui import UI_HELP

Captured = pytest.CaptureFixture[str]


def test_help_and_wrong_arguments(capsys: Captured) -> None:
    main(["ui", "--help"])
    assert capsys.readouterr().out == UI_HELP + "\n"
    for wrong, code in (("port=here", 1), ("open=perhaps", 2), ("prot=1", 2)):
        with pytest.raises(SystemExit) as caught:
            main(["ui", wrong])
        assert caught.value.code == code
        assert wrong.partition("=")[0] in capsys.readouterr().err


def test_without_runs_the_command_that_makes_one_is_named(
    tmp_path: object, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    with pytest.raises(SystemExit) as caught:
        main(["ui", f"work={tmp_path}"])
    assert caught.value.code == 1
    assert "`hlp run` makes one" in capsys.readouterr().err


def test_mlflows_own_variable_is_honoured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    assert tracking_uri("here") == "sqlite:///here/mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://server:5000")
    assert tracking_uri("here") == "http://server:5000"
