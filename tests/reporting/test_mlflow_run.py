"""What a run writes into MLflow while it goes."""

import logging
import re
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mlflow import MlflowClient

from hlp.reporting.mlflow_run import LoggedAs, MlflowRun, flatten, metric_name
from hlp.reporting.mlflow_tracking import MlflowSettings, track_run

LOSSES = [{"loss": 0.5, "accuracy": 0.75}, {"loss": 0.25, "accuracy": 0.875}]


def test_the_link_leads_to_the_run_with_the_loss_curves(tmp_path: Path) -> None:
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    with track_run(MlflowSettings(uri=uri, experiment="first"), "trains", {}) as tracker:
        assert tracker.log_training("encoder", "1f2e", LOSSES) == ""
        assert tracker.log_training("encoder", "1f2e", LOSSES) == ""  # its own
        first = tracker.run_id
    with track_run(MlflowSettings(uri=uri, experiment="second"), "reuses", {}) as tracker:
        words = tracker.log_training("encoder", "1f2e", LOSSES)
        assert tracker.log_training("classifier", "3d4c", []) == ""  # nothing is trained
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


@pytest.mark.parametrize(
    ("name", "clean"),
    [("recall@5cm[cat]", "recall_5cm_cat_"), ("time_ms/total p95", "time_ms/total p95")],
)
def test_names_that_mlflow_refuses_are_mended(name: str, clean: str) -> None:
    assert metric_name(name) == clean


def test_flatten() -> None:
    nested = {"a": {"b": {"c": 1}, "d": [1, 2]}, "e": {}}
    assert flatten(nested) == {"a.b.c": 1, "a.d": [1, 2], "e": {}}


PATIENCE = 300.0  # s; a busy machine takes long to import MLflow
THREAD = "system metrics"


class Client:
    """In place of MLflow's: remembers metrics by name, as (step, value)."""

    def __init__(self) -> None:
        self.logged: dict[str, list[tuple[int, float]]] = {}

    def get_run(self, run_id: str) -> Any:
        """The run began 100 s ago, as one that goes on."""
        return SimpleNamespace(info=SimpleNamespace(start_time=(time.time() - 100.0) * 1000))

    def log_batch(self, run_id: str, metrics: Any) -> None:
        for each in metrics:
            self.logged.setdefault(each.key, []).append((each.step, each.value))


def run_of(client: Any) -> MlflowRun:
    return MlflowRun(LoggedAs(client, "1", "abc"))


def is_sampled() -> bool:
    return THREAD in {each.name for each in threading.enumerate()}


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
    cores = [value for _, value in client.logged["system/cpu_cores"]]
    assert during >= 3 and len(cores) > during and max(cores) > 0.0
    steps = [step for step, _ in client.logged["system/cpu_cores"]]
    assert steps == sorted(steps) and 99 <= steps[0] < 200
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


def test_without_mlflow_there_is_no_thread() -> None:
    with MlflowRun(None).system_metrics(0.01):
        assert not is_sampled()


def test_a_failure_ends_the_metrics_but_not_the_run(caplog: pytest.LogCaptureFixture) -> None:
    class Full(Client):
        def get_run(self, run_id: str) -> Any:
            raise OSError("disk is full")

    with caplog.at_level(logging.WARNING), run_of(Full()).system_metrics(0.01):
        work_until(lambda: not is_sampled())
    assert [each.message for each in caplog.records] == ["no more system metrics: disk is full"]
