"""Loss curves are in the run that trained; a later run's description links to it."""

import re
from pathlib import Path

from mlflow import MlflowClient

from hlp.reporting.tracking import TrackingSettings, track_run
from hlp.reporting.trainings import log_training

LOSSES = [{"loss": 0.5, "accuracy": 0.75}, {"loss": 0.25, "accuracy": 0.875}]


def test_the_link_leads_to_the_run_with_the_loss_curves(tmp_path: Path) -> None:
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    with track_run(TrackingSettings(uri=uri, experiment="first"), "trains", {}) as tracker:
        assert log_training(tracker, "encoder", "1f2e", LOSSES) == ""
        assert log_training(tracker, "encoder", "1f2e", LOSSES) == ""  # its own
        first = tracker.run_id
    with track_run(TrackingSettings(uri=uri, experiment="second"), "reuses", {}) as tracker:
        words = log_training(tracker, "encoder", "1f2e", LOSSES)
        assert log_training(tracker, "classifier", "3d4c", []) == ""  # nothing is trained
        second = tracker.run_id

    link = re.fullmatch(r"encoder trained by \[trains\]\((.+)\)", words)
    assert link is not None
    page = re.match(r"#/experiments/(\d+)/runs/(\w+)\?", link[1])
    assert page is not None
    client = MlflowClient(uri)
    experiment_id, run_id = page.groups()
    run = client.get_run(run_id)
    assert (run.info.run_id, run.info.experiment_id) == (first, experiment_id)
    curve = client.get_metric_history(run_id, "encoder/loss")
    assert [(each.step, each.value) for each in curve] == [(0, 0.5), (1, 0.25)]
    assert len(client.get_metric_history(run_id, "encoder/accuracy")) == 2
    reused = client.get_run(second).data
    assert reused.tags["encoder_of_run"] == first and reused.metrics == {}
