from pathlib import Path

import pytest
import requests

from hlp.reporting.mlflow.tracking import MlflowSettings, track_run
from served_ui import served_ui


def test_without_runs_the_command_that_makes_one_is_named(tmp_path, monkeypatch, fails) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    assert "`hlp run` makes one" in fails("ui", f"work={tmp_path}")


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
