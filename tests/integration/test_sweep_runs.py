"""Sweeps of the tiny run's refiner: what MLflow has of them, and what an interruption costs."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mlflow import MlflowClient
from mlflow.entities import Run

from hlp.method.find.estimator import PoseEstimator
from hlp.reporting.mlflow_metrics import HEADLINES
from tiny_run import TinyRun

pytestmark = pytest.mark.slow

Call = Callable[..., tuple[int, str, str]]
PARENT = "mlflow.parentRunId"


def logged(folder: Path) -> tuple[MlflowClient, list[Run]]:
    client = MlflowClient(f"sqlite:///{folder / 'work' / 'mlflow.db'}")
    experiments = [each.experiment_id for each in client.search_experiments()]
    return client, client.search_runs(experiments)


def family(folder: Path, output: Path) -> tuple[MlflowClient, Run, list[Run]]:
    """The sweep's own run and those of its arms, oldest first."""
    client, runs = logged(folder)
    parent_id = json.loads((output / "sweep.json").read_text())["run_id"]
    (parent,) = [run for run in runs if run.info.run_id == parent_id]
    arms = [run for run in runs if run.data.tags.get(PARENT) == parent_id]
    return client, parent, sorted(arms, key=lambda run: run.info.start_time)


def sweep_of(tiny_run: TinyRun) -> Path:
    (record,) = (tiny_run.folder / "outputs" / "swept").glob("*/sweep.json")
    return record.parent


def test_failed_arm_is_a_failed_run_and_the_others_go_on(tiny_run: TinyRun, call: Call) -> None:
    """No particles: refused before any stage. The next run of the sweep is not stopped by it."""
    code, _, error = call("-m", *tiny_run.overrides, "refinement.particles=0,5", "output=failing")
    assert code == 1
    assert "refinement.particles is 0" in error
    output = tiny_run.folder / "failing"
    client, parent, arms = family(tiny_run.folder, output)
    assert parent.info.status == "FAILED"
    assert parent.info.run_name == "sweep of particles"
    assert set(parent.data.params) == {each.partition("=")[0] for each in tiny_run.overrides}
    named = [(arm.info.run_name, arm.info.status) for arm in arms]
    assert named == [
        ("particles 0", "FAILED"),
        ("particles 5", "FINISHED"),
    ]
    assert [arm.data.params["refinement.particles"] for arm in arms] == ["0", "5"]
    traceback = Path(client.download_artifacts(arms[0].info.run_id, "traceback.txt")).read_text()
    assert "refinement.particles is 0" in traceback
    whole = Path(client.download_artifacts(arms[1].info.run_id, "config.yaml")).read_text()
    assert "particles: 5" in whole
    summary = json.loads((output / "1" / "summary.json").read_text())
    assert arms[1].data.metrics["add"] == round(summary["metrics"]["add"]["recall"], 4)


@pytest.mark.thorough
def test_interrupted_sweep_goes_on_without_repeating_arms(
    tiny_run: TinyRun, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    overrides = ("-m", *tiny_run.overrides, "name=swept", "refinement.particles=5,6")
    refine = PoseEstimator.refine
    asked: set[int] = set()

    def counted(self: PoseEstimator, *arguments: Any) -> Any:
        asked.add(self.settings.refinement.particles)
        return refine(self, *arguments)

    def interrupted(self: PoseEstimator, *arguments: Any) -> Any:
        if self.settings.refinement.particles == 6:
            raise KeyboardInterrupt
        return refine(self, *arguments)

    monkeypatch.setattr(PoseEstimator, "refine", interrupted)
    assert call(*overrides)[0] == 130
    output = sweep_of(tiny_run)
    _, parent, arms = family(tiny_run.folder, output)
    assert [run.info.status for run in (parent, *arms)] == ["KILLED", "FINISHED", "KILLED"]
    first = (output / "0" / "summary.json").stat().st_mtime_ns

    monkeypatch.setattr(PoseEstimator, "refine", counted)
    code, said, _ = call(*overrides)
    assert code == 0
    assert f"continuing the sweep in {output.relative_to(tiny_run.folder)}" in said
    assert "finished already: particles 5" in said
    assert asked == {6}
    assert (output / "0" / "summary.json").stat().st_mtime_ns == first
    _, again, arms = family(tiny_run.folder, sweep_of(tiny_run))
    assert again.info.run_id == parent.info.run_id
    assert again.info.status == "FINISHED"
    found = [(arm.data.params["refinement.particles"], arm.info.status) for arm in arms]
    assert found == [("5", "FINISHED"), ("6", "FINISHED")]  # the one that was killed, continued
    shown = [{name: run.data.metrics[name] for name in HEADLINES} for run in (again, *arms)]
    best = max(shown[1:], key=lambda each: (each["add"], -each["ms"]))
    assert shown[0] == best


@pytest.mark.thorough
def test_anytime_draws_recall_against_the_time_of_each_budget(
    tiny_run: TinyRun, call: Call
) -> None:
    budgets = ("experiment=anytime", "refinement.budget_ms=0,1", "output=anytime")
    code, _, error = call(*tiny_run.overrides, *budgets)
    assert code == 0, error
    folder = tiny_run.folder / "anytime"
    with (folder / "recall_by_time.csv").open(newline="") as stream:
        unlimited, hasty = csv.DictReader(stream)
    assert [each["refinement.budget_ms"] for each in (unlimited, hasty)] == ["0", "1"]
    assert float(hasty["median_ms"]) > 0.0 and float(unlimited["median_ms"]) > 0.0
    client, parent, _ = family(tiny_run.folder, folder)
    logged_files = {each.path for each in client.list_artifacts(parent.info.run_id)}
    assert {"recall_by_time.png", "recall_by_time.svg"} <= logged_files


def test_a_sweep_of_studies_ends_with_table_figure_and_page(tiny_run: TinyRun, call: Call) -> None:
    """Also if an arm failed: no particles."""
    given = ("task=oracle", "task.frames=1", "refinement.particles=0,5,6", "output=oracles")
    code, said, error = call(*tiny_run.overrides, "-m", *given)
    assert code == 1 and "refinement.particles is 0" in error
    folder = tiny_run.folder / "oracles"
    words = " ".join(said.split())
    assert "oracle by particles: 2 of 3 arms finished; highest est/est: " in words
    assert "without a result: 0 (see 0/hlp.log)." in words
    assert "est/est to first" in words  # the default was not among the finished arms
    endings = ("md", "csv", "png", "svg")
    written = {"report.html", *(f"oracle.{ending}" for ending in endings)}
    assert written <= {path.name for path in folder.iterdir()}
    assert '<a href="2/report.html">' in (folder / "report.html").read_text()
    client, parent, _ = family(tiny_run.folder, folder)
    assert written <= {each.path for each in client.list_artifacts(parent.info.run_id)}
    assert "2 of 3 arms finished" in parent.data.tags["mlflow.note.content"]
    assert parent.data.tags["best_arm"] in ("5", "6")
    history = client.get_metric_history(parent.info.run_id, "sweep/oracle/est/est")
    assert [each.step for each in history] == [5, 6]
