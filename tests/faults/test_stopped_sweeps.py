"""A sweep that is stopped again and again: no arm is lost, and none is done twice."""

import shutil
import signal
from collections import Counter
from pathlib import Path

import pytest
from mlflow import MlflowClient
from process import SWEEP_PLACES, run_hlp, wait_until_gone

from run_files import read_json
from tiny_run import TinyRun

pytestmark = [pytest.mark.slow, pytest.mark.thorough]

CODES = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}


def test_a_sweep_stopped_at_every_place_ends_with_all_its_arms(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    """The same command each time; it continues in the same folder, as the same runs of MLflow."""
    shutil.copytree(tiny_run.folder / "work", tmp_path / "work")
    (tmp_path / "work" / "mlflow.db").unlink()
    command = ("run", "-m", *tiny_run.overrides, "panels=0", "name=swept", "machine.threads=1")
    command += ("refinement.particles=25,26",)
    for turn, place in enumerate(SWEEP_PLACES):
        number = list(CODES)[turn % len(CODES)]
        stopped = run_hlp(tmp_path, *command, place=place, number=int(number))
        assert stopped.returncode == CODES[number], (place, stopped.stderr)
        assert "Traceback" not in stopped.stderr, place
        assert wait_until_gone(tmp_path), place
    ended = run_hlp(tmp_path, *command)
    assert ended.returncode == 0, ended.stderr
    (record,) = (tmp_path / "outputs").glob("swept/*/sweep.json")
    assert read_json(record)["status"] == "FINISHED"
    first, second = (read_json(record.parent / arm / "manifest.json") for arm in "01")
    assert first["poses"] == read_json(tiny_run.output / "manifest.json")["poses"]
    assert second["config"]["refinement"]["particles"] == 26
    client = MlflowClient(f"sqlite:///{tmp_path / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("swept")
    assert experiment is not None
    runs = client.search_runs([experiment.experiment_id])
    parent = [run for run in runs if run.info.run_id == read_json(record)["run_id"]]
    assert [run.info.status for run in parent] == ["FINISHED"]
    arms = Counter(
        (run.data.params["refinement.particles"], run.info.status)
        for run in runs
        if run.data.tags.get("mlflow.parentRunId") == parent[0].info.run_id
    )
    assert arms == {("25", "FINISHED"): 1, ("26", "FINISHED"): 1}
    assert "RUNNING" not in {run.info.status for run in runs}
