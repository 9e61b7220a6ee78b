"""What a run writes into MLflow while it goes, and how it ends."""

import logging
import re
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mlflow import MlflowClient

from hlp.reporting.mlflow.run import LoggedAs, MlflowRun
from hlp.reporting.mlflow.tracking import REVISION, MlflowSettings, track_run

LOSSES = [{"loss": 0.5, "accuracy": 0.75}, {"loss": 0.25, "accuracy": 0.875}]
PATIENCE = 300.0  # s; a busy machine takes long to import MLflow
THREAD = "system metrics"


def test_a_run_holds_what_was_logged(settings: MlflowSettings, tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text("{}")
    (tmp_path / "panels").mkdir()
    (tmp_path / "panels" / "frame.png").write_bytes(b"png")
    params = {"seed": 3, "refinement.long": "x" * 7000}
    many = {f"group{i}.key": i for i in range(150)}
    config = {"data": {"name": "lm", "root": "x" * 7000}}
    revision = {REVISION: "0123abc"}
    with track_run(settings, "demo", config, revision, params=params | many) as tracker:
        tracker.log_metrics({"add/recall": 0.5, "add/recall_eggbox [2]": 1.0, "nothing": None})
        tracker.log_artifact(tmp_path / "summary.json")
        tracker.log_artifacts(tmp_path / "panels", "panels")
        tracker.log_input("lm frames", "0" * 40, "../data/lm", "evaluation")
        tracker.log_input("photographs", "12ab", "../data/photos", "training")

    run = MlflowClient(settings.uri).get_run(tracker.run_id)
    assert (run.info.status, run.info.run_name) == ("FINISHED", "demo")
    assert run.data.tags["mlflow.source.git.commit"] == "0123abc"
    assert run.data.metrics == {"add/recall": 0.5, "add/recall_eggbox _2_": 1.0}
    assert len(run.data.params["refinement.long"]) == 6000
    assert run.data.params["group149.key"] == "149"
    artifacts = Path(run.info.artifact_uri.removeprefix("file://"))
    database = Path(settings.uri.removeprefix("sqlite:///"))
    assert artifacts.is_relative_to(database.parent / "mlflow-artifacts")
    assert (artifacts / "summary.json").read_text() == "{}"
    assert (artifacts / "panels" / "frame.png").read_bytes() == b"png"
    assert "x" * 7000 in (artifacts / "config.yaml").read_text()
    inputs = {
        data.dataset.name: (data.dataset.digest, data.dataset.source, data.tags[0].value)
        for data in run.inputs.dataset_inputs
    }
    assert inputs == {
        "lm frames": ("0" * 36, '{"uri": "../data/lm"}', "evaluation"),
        "photographs": ("12ab", '{"uri": "../data/photos"}', "training"),
    }
    assert f"/runs/{tracker.run_id}?" in tracker.page_path


def test_the_link_leads_to_the_run_with_the_loss_curves(settings: MlflowSettings) -> None:
    client = MlflowClient(settings.uri)
    with track_run(settings, "trains", {}) as tracker:
        assert tracker.log_training("encoder", "1f2e", LOSSES) == ""
        assert tracker.log_training("encoder", "1f2e", LOSSES) == ""  # its own
        first = tracker.run_id
    other = MlflowSettings(uri=settings.uri, experiment="second")
    with track_run(other, "reuses", {}) as tracker:
        words = tracker.log_training("encoder", "1f2e", LOSSES)
        assert tracker.log_training("classifier", "3d4c", []) == ""  # nothing is trained
        second = tracker.run_id

    link = re.fullmatch(
        r"encoder trained by \[trains\]\(#/experiments/(\d+)/runs/(\w+)\?.+\)", words
    )
    assert link is not None and link[2] == first
    assert client.get_run(first).info.experiment_id == link[1]
    curve = client.get_metric_history(first, "encoder/loss")
    assert [(value.step, value.value) for value in curve] == [(0, 0.5), (1, 0.25)]
    assert len(client.get_metric_history(first, "encoder/accuracy")) == 2
    reused = client.get_run(second).data
    assert reused.tags["encoder_of_run"] == first and reused.metrics == {}


class Client:
    """In place of MLflow's: remembers metrics by name, as (step, value)."""

    def __init__(self) -> None:
        self.logged: dict[str, list[tuple[int, float]]] = {}

    def get_run(self, run_id: str) -> Any:
        """The run began 100 s ago, as one that goes on."""
        return SimpleNamespace(info=SimpleNamespace(start_time=(time.time() - 100.0) * 1000))

    def log_batch(self, run_id: str, metrics: Any) -> None:
        for metric in metrics:
            self.logged.setdefault(metric.key, []).append((metric.step, metric.value))


class Full(Client):
    """Fails at once."""

    def get_run(self, run_id: str) -> Any:
        raise OSError("disk is full")


def run_of(client: Any) -> MlflowRun:
    return MlflowRun(LoggedAs(client, "1", "abc"))


def is_sampled() -> bool:
    return THREAD in {thread.name for thread in threading.enumerate()}


def work_until(condition: Any) -> None:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        sum(range(10_000))


def test_what_a_run_uses_is_logged_while_it_runs_and_at_its_end() -> None:
    client = Client()
    with run_of(client).system_metrics(0.01):
        assert is_sampled()
        work_until(lambda: len(client.logged.get("system/cpu_cores", ())) >= 3)
        during = len(client.logged["system/cpu_cores"])
    assert not is_sampled()
    steps, cores = zip(*client.logged["system/cpu_cores"], strict=True)
    assert during >= 3 and len(cores) > during and max(cores) > 0.0
    assert list(steps) == sorted(steps) and 99 <= steps[0] < 200
    memory = [value for _, value in client.logged["system/memory_megabytes"]]
    (peak,) = client.logged["system/peak_memory_megabytes"]
    assert 10.0 < max(memory) < peak[1] * 1.05  # Linux counts both in batches
    assert client.logged["system/cpu_seconds"][0][1] > 0.0


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_the_thread_ends_with_a_run_that_fails_or_is_stopped(error: type[BaseException]) -> None:
    client = Client()
    with pytest.raises(error), run_of(client).system_metrics(1000.0):
        raise error
    assert not is_sampled()
    assert len(client.logged["system/cpu_cores"]) == 1
    assert "system/cpu_seconds" not in client.logged


def test_without_mlflow_there_is_no_thread_and_nothing_is_logged(tmp_path: Path) -> None:
    nothing = MlflowRun(None)
    with nothing.system_metrics(0.01):
        assert not is_sampled()
    nothing.log_image(tmp_path / "absent.png", "key", 0)
    nothing.log_params({"a": 1})
    nothing.describe("words")
    nothing.log_input("frames", "12ab", "there", "evaluation")
    assert nothing.run_id == nothing.page_path == nothing.log_training("encoder", "1", LOSSES) == ""


def test_a_failure_ends_the_metrics_but_not_the_run(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING), run_of(Full()).system_metrics(0.01):
        work_until(lambda: not is_sampled())
    assert caplog.messages == ["no more system metrics: disk is full"]
