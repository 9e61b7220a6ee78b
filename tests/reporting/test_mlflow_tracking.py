import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from mlflow import MlflowClient
from mlflow.exceptions import MlflowException

import hlp
from hlp.errors import ConfigError, DataError, is_expected
from hlp.reporting.mlflow_store import owner_tags
from hlp.reporting.mlflow_tracking import (
    ChildRun,
    MlflowSettings,
    as_child_run,
    track_run,
)


@pytest.fixture(scope="module")
def settings(mlflow_settings: MlflowSettings) -> MlflowSettings:
    return mlflow_settings


def test_crash_leaves_a_failed_run_with_its_traceback(settings: MlflowSettings) -> None:
    with pytest.raises(ValueError, match="no views"), track_run(settings, "demo", {}) as tracker:
        raise ValueError("no views")
    run = MlflowClient(settings.uri).get_run(tracker.run_id)
    assert run.info.status == "FAILED"
    assert run.data.tags["error"] == "ValueError: no views"
    text = (Path(run.info.artifact_uri.removeprefix("file://")) / "traceback.txt").read_text()
    assert "test_mlflow_tracking.py" in text
    assert text.endswith("ValueError: no views\n")


def test_interruption_leaves_a_killed_run(settings: MlflowSettings) -> None:
    with pytest.raises(KeyboardInterrupt), track_run(settings, "demo", {}) as tracker:
        raise KeyboardInterrupt
    assert MlflowClient(settings.uri).get_run(tracker.run_id).info.status == "KILLED"


def test_an_arm_has_its_parent_and_its_own_name(settings: MlflowSettings) -> None:
    swept = {"refinement": "icp", "seed": "0"}
    with (
        track_run(settings, "sweep", {}) as parent,
        as_child_run(ChildRun("demo 0: refinement=icp", parent.run_id, swept)),
        track_run(settings, "as ever", {"refinement": {"name": "icp"}, "seed": 0}) as child,
    ):
        pass
    run = MlflowClient(settings.uri).get_run(child.run_id)
    assert run.info.run_name == "demo 0: refinement=icp"
    assert run.data.tags["mlflow.parentRunId"] == parent.run_id
    assert run.data.params == {"refinement": "icp", "seed": "0"}
    with track_run(settings, "alone", {}) as alone:
        pass
    tags = MlflowClient(settings.uri).get_run(alone.run_id).data.tags
    assert "mlflow.parentRunId" not in tags


def test_a_run_goes_on(settings: MlflowSettings) -> None:
    client = MlflowClient(settings.uri)
    with (
        pytest.raises(OSError, match="disk"),
        track_run(settings, "s", {}, params={"a": 1}) as first,
    ):
        raise OSError("disk")
    with track_run(settings, "s", {}, resume=first.run_id, params={"a": 2}) as again:
        assert client.get_run(first.run_id).info.status == "RUNNING"
    assert again.run_id == first.run_id
    run = client.get_run(first.run_id)
    assert run.info.status == "FINISHED"
    assert "error" not in run.data.tags
    with track_run(settings, "sweep", {}, resume="0" * 32) as new:  # another database by now
        pass
    assert new.run_id != "0" * 32
    assert client.get_run(new.run_id).info.run_name == "sweep"
    assert run.data.params == {"a": "1"}  # MLflow lets none be changed


def test_a_retried_child_is_the_same_child(settings: MlflowSettings) -> None:
    """Of another parent it is another one."""
    ids = []
    with track_run(settings, "sweep", {}) as parent:
        child = ChildRun("demo 0: seed=0", parent.run_id, {"seed": "0"})
        with (
            pytest.raises(OSError, match="disk"),
            as_child_run(child),
            track_run(settings, "", {}, params={"config": "unread"}) as first,
        ):
            raise OSError("disk")
        for of in (child, child, ChildRun(child.name, "0" * 32, {"seed": "0"})):
            with as_child_run(of), track_run(settings, "", {}, params={"a": "1"}) as again:
                ids.append(again.run_id)
    assert ids[0] == ids[1] == first.run_id  # however it ended
    assert ids[2] != first.run_id
    params = MlflowClient(settings.uri).get_run(first.run_id).data.params
    assert params == {"seed": "0", "config": "unread", "a": "1"}


def begin_and_die(settings: MlflowSettings) -> None:
    with track_run(settings, "dies", {}):
        os.kill(os.getpid(), signal.SIGKILL)


def test_runs_of_dead_processes_are_closed_as_killed(settings: MlflowSettings) -> None:
    dead = multiprocessing.get_context("spawn").Process(target=begin_and_die, args=(settings,))
    dead.start()
    dead.join(timeout=120)
    assert dead.exitcode == -signal.SIGKILL
    client = MlflowClient(settings.uri)
    experiment = client.get_experiment_by_name("hlp").experiment_id

    def status(name: str) -> str:
        (run,) = client.search_runs([experiment], f"attributes.run_name = '{name}'")
        return str(run.info.status)

    elsewhere = client.create_run(
        experiment, run_name="elsewhere", tags=owner_tags() | {"hlp.host": "another"}
    )
    assert status("dies") == "RUNNING"
    with track_run(settings, "lives", {}), track_run(settings, "next", {}):
        assert status("dies") == "KILLED"
        assert status("lives") == "RUNNING"
        assert status("elsewhere") == "RUNNING"
    client.set_terminated(elsewhere.info.run_id)


@pytest.mark.parametrize("uri", ["nonsense://x", "sqlite:////dev/null/db"])
def test_an_address_that_cannot_be_used_is_named_in_seconds(uri: str) -> None:
    begun = time.monotonic()
    wrong = MlflowSettings("mlflow", uri, "hlp")
    with pytest.raises((ConfigError, OSError)) as caught, track_run(wrong, "demo", {}):
        pass
    assert time.monotonic() - begun < 30.0
    assert is_expected(caught.value)


def test_a_server_that_dies_meanwhile_hides_no_error(
    settings: MlflowSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: Any, **__: Any) -> None:
        raise MlflowException("connection refused")

    with pytest.raises(ValueError, match="a bug"), track_run(settings, "demo", {}):
        monkeypatch.setattr(MlflowClient, "set_tag", gone)
        raise ValueError("a bug")
    with pytest.raises(DataError, match=r"failed: connection"), track_run(settings, "demo", {}):
        gone()


def test_a_database_that_cannot_be_written_is_one_line_however_early_or_late(
    settings: MlflowSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise MlflowException("database or disk is full\n[SQL: INSERT INTO runs]")

    with pytest.raises(DataError, match=r"failed: database or disk is full$"):  # noqa: SIM117
        with track_run(settings, "at its end", {}):
            monkeypatch.setattr(MlflowClient, "set_terminated", full)
    monkeypatch.setattr(MlflowClient, "create_run", full)
    with (
        pytest.raises(DataError, match=r"failed: database or disk is full$"),
        track_run(settings, "at its beginning", {}),
    ):
        pass


def test_nothing_is_told_to_mlflows_makers() -> None:
    code = (
        "import os; from hlp.reporting.mlflow_store import import_client; import_client();"
        "from mlflow.telemetry.utils import is_telemetry_disabled as off; assert off()"
    )
    clean = ("MLFLOW_DISABLE_TELEMETRY", "DO_NOT_TRACK", "CI", "PYTEST_CURRENT_TEST")
    environment = {key: value for key, value in os.environ.items() if key not in clean}
    environment["PYTHONPATH"] = str(Path(hlp.__file__).parents[1])
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)


def log_one(settings: MlflowSettings, barrier: Any, number: int) -> None:
    barrier.wait()
    with track_run(settings, f"run {number}", {"number": number}) as tracker:
        tracker.log_metrics({"number": number})


@pytest.mark.slow
@pytest.mark.thorough
def test_processes_that_start_together_share_one_new_database(tmp_path: Path) -> None:
    settings = MlflowSettings("mlflow", f"sqlite:///{tmp_path / 'mlflow.db'}", "race")
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(8)
    runs = [context.Process(target=log_one, args=(settings, barrier, i)) for i in range(8)]
    for run in runs:
        run.start()
    for run in runs:
        run.join()
    client = MlflowClient(settings.uri)
    experiment = client.get_experiment_by_name("race")
    found = client.search_runs([experiment.experiment_id])
    assert sorted(run.data.metrics["number"] for run in found) == list(range(8))
    assert {run.info.status for run in found} == {"FINISHED"}
