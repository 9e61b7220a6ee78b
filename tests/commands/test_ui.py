from pathlib import Path

import pytest
import requests

from hlp.cli import main
from hlp.commands.tracking_uri import tracking_uri
from hlp.commands.ui import UI_HELP
from hlp.reporting.mlflow_tracking import MlflowSettings, track_run
from served_ui import served_ui

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


@pytest.mark.slow
def test_the_server_answers_on_this_machine_until_it_is_stopped(tmp_path: Path) -> None:
    settings = MlflowSettings(uri=f"sqlite:///{tmp_path / 'mlflow.db'}", experiment="shown")
    with track_run(settings, "a run", {}) as tracker:
        experiment = tracker.place.experiment_id if tracker.place else ""
    with served_ui(tmp_path) as page:
        address, _, path = page.partition("#")
        assert path.startswith(f"/experiments/{experiment}/runs?")
        assert "MLflow" in requests.get(address, timeout=60).text
    with pytest.raises(requests.ConnectionError):
        requests.get(address, timeout=5)
