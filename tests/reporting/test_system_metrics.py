import logging
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

from hlp.reporting.system_metrics import system_metrics
from hlp.reporting.tracker import LoggedAs, Tracker

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


def tracker_of(client: Any) -> Tracker:
    return Tracker(LoggedAs(client, "1", "abc"))


def is_sampled() -> bool:
    return THREAD in {each.name for each in threading.enumerate()}


def work_until(condition: Any) -> None:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        sum(range(10_000))


def test_what_a_run_uses_is_logged_while_it_runs_and_at_its_end() -> None:
    client = Client()
    with system_metrics(tracker_of(client), 0.01):
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
    with pytest.raises(error), system_metrics(tracker_of(client), 1000.0):
        raise error
    assert not is_sampled()
    assert len(client.logged["system/cpu_cores"]) == 1
    assert "system/cpu_seconds" not in client.logged


def test_without_mlflow_there_is_no_thread() -> None:
    with system_metrics(Tracker(None), 0.01):
        assert not is_sampled()


def test_a_failure_ends_the_metrics_but_not_the_run(caplog: pytest.LogCaptureFixture) -> None:
    class Full(Client):
        def get_run(self, run_id: str) -> Any:
            raise OSError("disk is full")

    with caplog.at_level(logging.WARNING), system_metrics(tracker_of(Full()), 0.01):
        work_until(lambda: not is_sampled())
    assert [each.message for each in caplog.records] == ["no more system metrics: disk is full"]
