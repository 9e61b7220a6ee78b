"""Reading what a run leaves in its output folder, in its work folder and in MLflow."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mlflow import MlflowClient
from mlflow.entities import Run

from hlp.geometry import rigid
from hlp.reporting.study_numbers import KINDS, read_numbers
from hlp.results.recalls import read_target_values


def read_json(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def stages(output: Path, *, reused: bool) -> dict[str, int]:
    """How many outputs of each stage a run reused or made, by its manifest."""
    counts: dict[str, int] = {}
    for event in read_json(output / "manifest.json")["stages"]:
        if event["reused"] == reused:
            counts[event["stage"]] = counts.get(event["stage"], 0) + 1
    return counts


def poses_of(output: Path) -> str:
    """The digest of a run's poses."""
    return str(read_json(output / "manifest.json")["poses"])


def assert_targets_have_the_means_of_the_study(output: Path, study: str) -> None:
    """What a study states of each target has the means that it states of all."""
    numbers = read_numbers(output, KINDS[study])
    targets = read_target_values(output)
    means = {name: sum(values.values()) / len(values) for name, values in targets.items()}
    assert means == pytest.approx({name: numbers[name].value for name in means})


def stated_pose(answer: dict[str, Any]) -> np.ndarray:
    """The pose (4, 4) that BOP's rotation and translation in millimetres state."""
    return rigid(np.reshape(answer["cam_R_m2c"], (3, 3)), np.array(answer["cam_t_m2c"]) / 1000.0)


def logged_runs(folder: Path, work: str = "work") -> tuple[MlflowClient, list[Run]]:
    """All runs in the database of a folder's `work`, oldest first."""
    client = MlflowClient(f"sqlite:///{folder / work / 'mlflow.db'}")
    experiments = [experiment.experiment_id for experiment in client.search_experiments()]
    return client, sorted(client.search_runs(experiments), key=lambda run: run.info.start_time)


def logged_run(folder: Path, output: Path | str) -> tuple[MlflowClient, Run]:
    """The run that wrote into an output folder, given by its whole path or its name."""
    client, runs = logged_runs(folder)
    (run,) = [run for run in runs if run.data.tags.get("output", "").endswith(str(output))]
    return client, run


def children_of(folder: Path, output: Path) -> tuple[MlflowClient, Run, list[Run]]:
    """A sweep's own run and those of its settings, oldest first."""
    client, runs = logged_runs(folder)
    parent_id = read_json(output / "sweep.json")["run_id"]
    (parent,) = [run for run in runs if run.info.run_id == parent_id]
    children = [run for run in runs if run.data.tags.get("mlflow.parentRunId") == parent_id]
    return client, parent, children
