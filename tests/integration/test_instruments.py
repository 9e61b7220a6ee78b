"""Oracle matrix and basin map on the tiny run's dataset and stages."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest
import torch
from hydra import compose, initialize_config_dir
from mlflow import MlflowClient

from hlp.commands.composing import config_folder
from hlp.config.build import Run, build_run
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.refinement.none import NoneRefiner
from hlp.reporting.study_numbers import STUDIES, read_study
from hlp.results.summary_file import read_target_values
from hlp.studies.tasks import run_task
from tiny_run import TinyRun

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    """Tasks set the number of threads of torch and OpenCV."""
    number = torch.get_num_threads()
    yield
    torch.set_num_threads(number)
    cv2.setNumThreads(-1)


def build(tiny_run: TinyRun, experiment: str, *overrides: str) -> Run:
    given = (f"experiment={experiment}", f"work={tiny_run.folder / 'work'}", "output=out")
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return build_run(compose("config", overrides=[*tiny_run.overrides, *given, *overrides]))


def stages(output: Path, *, reused: bool) -> set[str]:
    events = json.loads((output / "manifest.json").read_text())["stages"]
    return {event["stage"] for event in events if event["reused"] == reused}


def logged_metrics(tiny_run: TinyRun, output: Path) -> dict[str, float]:
    client = MlflowClient(f"sqlite:///{tiny_run.folder / 'work' / 'mlflow.db'}")
    experiments = [each.experiment_id for each in client.search_experiments()]
    (run,) = client.search_runs(experiments, f"tags.output = '{output}'")
    assert run.info.status == "FINISHED"
    metrics: dict[str, float] = run.data.metrics
    return metrics


def recalls(result: dict[str, Any]) -> dict[tuple[str, str], float]:
    return {(c["region"], c["coarse"]): c["add"]["recall"] for c in result["cells"]}


def assert_targets_have_the_means_of_the_study(output: Path, study: str) -> None:
    numbers = read_study(output, STUDIES[study])
    assert numbers is not None
    targets = read_target_values(output)
    means = {name: sum(each.values()) / len(each) for name, each in targets.items()}
    assert means == pytest.approx({each.name: each.value for each in numbers})


def test_oracle_fills_the_matrix_from_the_runs_own_stages(
    tiny_run: TinyRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "matrix"
    run_task(build(tiny_run, "oracle"), output)
    assert stages(output, reused=False) == {"oracle"}
    assert {"regions", "hypotheses"} <= stages(output, reused=True)
    found = recalls(json.loads((output / "oracle.json").read_text()))
    summary = json.loads((tiny_run.output / "summary.json").read_text())
    # Two of ten targets at most: the run also decides which of two objects is at a place.
    assert abs(found["estimated", "estimated"] - summary["metrics"]["add"]["recall"]) < 0.21
    assert found["true", "true"] >= 0.8  # the refiner starts where it should end
    assert found["true", "true"] >= found["estimated", "true"]
    assert_targets_have_the_means_of_the_study(output, "oracle")
    assert (output / "oracle.md").read_text().strip()
    assert {"oracle.png", "oracle.svg"} <= {path.name for path in output.iterdir()}
    with (output / "oracle.csv").open(newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if row["object"] == "all"]
    shown = {(row["region"], row["coarse"]): float(row["add_recall"]) for row in rows}
    assert shown == pytest.approx(found)
    assert f"{found['true', 'noisy']:.3f}" in capsys.readouterr().out
    metrics = logged_metrics(tiny_run, output)
    assert metrics["oracle/region_true/coarse_true"] == found["true", "true"]


def test_interrupted_oracle_goes_on_where_it_stopped(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refine = PoseEstimator.refine
    asked: set[int] = set()

    def interrupted(self: PoseEstimator, context: FrameContext, *given: Any) -> Any:
        if context.frame.scene_id == 12:
            raise KeyboardInterrupt
        return refine(self, context, *given)

    def noted(self: PoseEstimator, context: FrameContext, *given: Any) -> Any:
        asked.add(context.frame.scene_id)
        return refine(self, context, *given)

    short = ("refinement.particles=5", "refinement.iterations=3", "task.noise_deg=5.0")
    monkeypatch.setattr(PoseEstimator, "refine", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_task(build(tiny_run, "oracle", *short), tmp_path / "broken_off")
    monkeypatch.setattr(PoseEstimator, "refine", noted)
    run_task(build(tiny_run, "oracle", *short), tmp_path / "resumed")
    assert asked == {12}
    asked.clear()
    run_task(build(tiny_run, "oracle", *short, "task.frames=1"), tmp_path / "one")
    assert asked == {0}
    assert json.loads((tmp_path / "one" / "oracle.json").read_text())["frames"] == 1


def test_basin_maps_every_refiner_from_the_same_starts(
    tiny_run: TinyRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = (
        "task.compared=[pso,none]",
        "task.frames=1",
        "task.rotation_deg=[0,25]",
        "task.translation_mm=[0,200]",
        "task.perturbations=2",
    )
    output = tmp_path / "maps"
    run_task(build(tiny_run, "basin", *small), output)
    assert (stages(output, reused=False), stages(output, reused=True)) == ({"basin"}, set())
    with (output / "basin.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    cells = {
        (r["refiner"], r["object"], float(r["rotation_deg"]), float(r["translation_mm"])): r
        for r in rows
    }
    assert_targets_have_the_means_of_the_study(output, "basin")
    objects = {row["object"] for row in rows} - {"all"}
    targets = int(cells["pso", "all", 0.0, 0.0]["perturbations"]) // 2
    assert targets == len(objects) == 5
    assert all(cells["none", name, 0.0, 0.0]["right"] == "2" for name in objects)
    assert float(cells["pso", "all", 0.0, 0.0]["add_recall"]) >= 0.8
    turned = {
        refiner: float(cells[refiner, "all", 25.0, 0.0]["add_recall"])
        for refiner in ("pso", "none")
    }
    assert turned["pso"] > turned["none"] + 0.2
    assert cells["none", "all", 0.0, 200.0]["right"] == "0"
    drawn = {path.stem for path in (output / "heatmaps").glob("*.png")}
    assert drawn == objects | {"all"} == {path.stem for path in (output / "heatmaps").glob("*.svg")}
    assert "perturbations each" in capsys.readouterr().out
    assert logged_metrics(tiny_run, output)["basin/none/all"] < 0.5


def test_a_refiner_that_is_added_leaves_the_others_as_they_are(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = ("task.frames=1", "task.rotation_deg=[0]", "task.translation_mm=[0,10]")
    run_task(build(tiny_run, "basin", *small, "task.compared=[none]"), tmp_path / "first")
    monkeypatch.setattr(NoneRefiner, "refine", None)
    run_task(build(tiny_run, "basin", *small, "task.compared=[none,icp]"), tmp_path / "second")
    assert stages(tmp_path / "second", reused=True) == {"basin"}
    assert (
        (tmp_path / "second" / "basin.csv")
        .read_text()
        .startswith((tmp_path / "first" / "basin.csv").read_text())
    )
