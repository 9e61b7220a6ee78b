"""How a run in MLflow is opened, goes on and ends."""

import multiprocessing
import os
import subprocess
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from mlflow import MlflowClient
from mlflow.exceptions import MlflowException

import hlp
from hlp.errors import ConfigError, DataError, is_expected
from hlp.reporting.mlflow import owner_tags
from hlp.reporting.mlflow.run import LoggedAs, MlflowRun
from hlp.reporting.mlflow.tracking import ChildRun, MlflowSettings, as_child_run, track_run

if TYPE_CHECKING:
    from mlflow.entities import Run

DISK = OSError("disk")


def tracked(
    settings: MlflowSettings, name: str = "demo", error: BaseException | None = None, **given: Any
) -> "Run":
    """A run that ends at once, or with an error, as MLflow has it."""
    expected = nullcontext() if error is None else pytest.raises(type(error), match=str(error))
    with expected, track_run(settings, name, {}, **given) as run:
        if error is not None:
            raise error
    return MlflowClient(settings.uri).get_run(run.run_id)


def test_crash_leaves_a_failed_run_with_its_traceback(settings: MlflowSettings) -> None:
    run = tracked(settings, error=ValueError("no views"))
    assert run.info.status == "FAILED"
    assert run.data.tags["error"] == "ValueError: no views"
    text = (Path(run.info.artifact_uri.removeprefix("file://")) / "traceback.txt").read_text()
    assert "test_mlflow_tracking.py" in text
    assert text.endswith("ValueError: no views\n")
    assert tracked(settings, error=KeyboardInterrupt("Ctrl-C")).info.status == "KILLED"


def test_a_child_has_its_parent_and_its_own_name(settings: MlflowSettings) -> None:
    swept = {"refinement": "icp", "seed": "0"}
    with (
        track_run(settings, "sweep", {}) as parent,
        as_child_run(ChildRun("demo 0: refinement=icp", parent.run_id, swept)),
    ):
        child = tracked(settings, "as ever")
    assert child.info.run_name == "demo 0: refinement=icp"
    assert child.data.tags["mlflow.parentRunId"] == parent.run_id
    assert child.data.params == {"refinement": "icp", "seed": "0"}
    assert "mlflow.parentRunId" not in tracked(settings, "alone").data.tags


def test_a_run_goes_on(settings: MlflowSettings) -> None:
    first = tracked(settings, "s", DISK, params={"a": 1}).info.run_id
    with track_run(settings, "s", {}, resume=first, params={"a": 2}) as again:
        assert MlflowClient(settings.uri).get_run(first).info.status == "RUNNING"
    assert again.run_id == first
    run = MlflowClient(settings.uri).get_run(first)
    assert run.info.status == "FINISHED"
    assert "error" not in run.data.tags
    assert run.data.params == {"a": "1"}  # MLflow lets none be changed
    new = tracked(settings, "sweep", resume="0" * 32)  # another database by now
    assert new.info.run_id != "0" * 32 and new.info.run_name == "sweep"


def test_a_retried_child_is_the_same_child(settings: MlflowSettings) -> None:
    """Of another parent it is another one."""
    with track_run(settings, "sweep", {}) as parent:
        child = ChildRun("demo 0: seed=0", parent.run_id, {"seed": "0"})
        with as_child_run(child):
            first = tracked(settings, "", DISK, params={"config": "unread"})
            again = [tracked(settings, "", params={"a": "1"}) for _ in range(2)]
        with as_child_run(ChildRun(child.name, "0" * 32, {"seed": "0"})):
            other = tracked(settings, "")
    assert {run.info.run_id for run in again} == {first.info.run_id}  # however it ended
    assert other.info.run_id != first.info.run_id
    assert again[1].data.params == {"seed": "0", "config": "unread", "a": "1"}


def test_runs_of_dead_processes_are_closed_as_killed(settings: MlflowSettings) -> None:
    client = MlflowClient(settings.uri)
    experiment = tracked(settings).info.experiment_id
    with subprocess.Popen(["true"]) as dead:
        dead.wait()
    client.create_run(
        experiment, run_name="dies", tags=owner_tags() | {"hlp.process": str(dead.pid)}
    )

    def status(name: str) -> str:
        (run,) = client.search_runs([experiment], f"attributes.run_name = '{name}'")
        return str(run.info.status)

    tags = owner_tags() | {"hlp.host": "another"}
    elsewhere = client.create_run(experiment, run_name="elsewhere", tags=tags)
    assert status("dies") == "RUNNING"
    with track_run(settings, "lives", {}), track_run(settings, "next", {}):
        assert status("dies") == "KILLED"
        assert status("lives") == "RUNNING"
        assert status("elsewhere") == "RUNNING"
    client.set_terminated(elsewhere.info.run_id)


def test_a_run_whose_server_goes_away_goes_on_aside(caplog: pytest.LogCaptureFixture) -> None:
    here, aside = (LoggedAs(object(), place, place) for place in ("here", "aside"))  # type: ignore[arg-type]

    def call(client: object, run_id: str) -> str:
        if client is here.client:
            raise MlflowException("API request to http://server failed")
        return run_id

    run = MlflowRun(here, lambda: aside)
    assert [run.send(call), run.send(call)] == ["aside", "aside"]
    assert run.run_id == "aside" and caplog.text.count("hlp upload") == 1
    with pytest.raises(MlflowException, match="API request"):
        MlflowRun(here).send(call)


def test_what_goes_on_aside_is_a_run_of_its_own(
    settings: MlflowSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An earlier one of the same child, which is kept there too, may have been sent already."""
    settings = replace(settings, unsent=f"sqlite:///{tmp_path / 'mlflow.db'}")
    monkeypatch.setattr("hlp.reporting.mlflow.tracking.is_local", lambda uri: False)

    def go_away(client: MlflowClient, _: str) -> None:
        if client.tracking_uri == settings.uri:
            raise MlflowException("API request to http://server failed")

    aside = []
    for _ in range(2):
        with as_child_run(ChildRun("a", "1" * 32, {})), track_run(settings, "", {}) as run:
            run.send(go_away)
            aside.append(run.run_id)
    there = [MlflowClient(settings.unsent).get_run(run_id) for run_id in dict.fromkeys(aside)]
    assert len(there) == 2 and len({run.data.tags["hlp.continues"] for run in there}) == 1


@pytest.mark.parametrize("uri", ["nonsense://x", "sqlite:////dev/null/db"])
def test_an_address_that_cannot_be_used_is_named_in_seconds(uri: str) -> None:
    begun = time.monotonic()
    with pytest.raises((ConfigError, OSError)) as caught:
        tracked(MlflowSettings(uri=uri))
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


@pytest.mark.parametrize("call", ["create_run", "set_terminated"])  # at the beginning, at the end
def test_a_database_that_cannot_be_written_is_one_line(
    settings: MlflowSettings, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise MlflowException("database or disk is full\n[SQL: INSERT INTO runs]")

    monkeypatch.setattr(MlflowClient, call, full)
    with pytest.raises(DataError, match=r"failed: database or disk is full$"):
        tracked(settings)


@pytest.mark.slow
def test_nothing_is_told_to_mlflows_makers() -> None:
    code = (
        "import os; from hlp.reporting.mlflow import import_client; import_client();"
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
    settings = MlflowSettings(uri=f"sqlite:///{tmp_path / 'mlflow.db'}", experiment="race")
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
