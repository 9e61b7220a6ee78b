"""Oracle matrix and basin map on the tiny run's dataset and stages."""

import pytest

from hlp.method.find.estimator import PoseEstimator
from hlp.refinement.refiner import NoneRefiner
from run_files import assert_targets_have_the_means_of_the_study, logged_run, read_json, stages
from table_text import csv_rows

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("threads")]


def run_experiment(tiny_run, name, output, *overrides):
    run = tiny_run.build(f"experiment={name}", *overrides)
    run.settings.task.run(run, output)


def logged_metrics(tiny_run, output):
    _, run = logged_run(tiny_run.folder, output)
    assert run.info.status == "FINISHED"
    return run.data.metrics


def test_oracle_fills_the_matrix_from_the_runs_own_stages(tiny_run, tmp_path, capsys):
    output = tmp_path / "matrix"
    run_experiment(tiny_run, "oracle", output)
    assert stages(output, reused=False).keys() == {"oracle"}
    assert {"regions", "hypotheses"} <= stages(output, reused=True).keys()
    cells = read_json(output / "oracle.json")["cells"]
    found = {(cell["region"], cell["coarse"]): cell["add"]["recall"] for cell in cells}
    summary = read_json(tiny_run.output / "summary.json")
    # Two of ten targets at most: the run also decides which of two objects is at a place.
    assert abs(found["estimated", "estimated"] - summary["metrics"]["add"]["recall"]) < 0.21
    assert found["true", "true"] >= 0.8  # the refiner starts where it should end
    assert found["true", "true"] >= found["estimated", "true"]
    assert_targets_have_the_means_of_the_study(output, "oracle")
    assert (output / "oracle.md").read_text().strip()
    assert {"oracle.png", "oracle.svg"} <= {path.name for path in output.iterdir()}
    assert f"{found['true', 'true']:.3f}" in capsys.readouterr().out
    metrics = logged_metrics(tiny_run, output)
    assert metrics["oracle/true/true"] == found["true", "true"]


def test_interrupted_oracle_goes_on_where_it_stopped(tiny_run, tmp_path, monkeypatch):
    refine = PoseEstimator.refine
    refined = set()
    stopped = {12}

    def noted(self, context, *given):
        if context.frame.scene_id in stopped:
            raise KeyboardInterrupt
        refined.add(context.frame.scene_id)
        return refine(self, context, *given)

    short = ("refinement.particles=5", "refinement.iterations=3", "task.agree_mm=15.0")
    monkeypatch.setattr(PoseEstimator, "refine", noted)
    with pytest.raises(KeyboardInterrupt):
        run_experiment(tiny_run, "oracle", tmp_path / "broken_off", *short)
    stopped.clear()
    refined.clear()
    run_experiment(tiny_run, "oracle", tmp_path / "resumed", *short)
    assert refined == {12}
    refined.clear()
    run_experiment(tiny_run, "oracle", tmp_path / "one", *short, "task.frames=1")
    assert refined == {0}
    assert read_json(tmp_path / "one" / "oracle.json")["frames"] == 1


def test_basin_maps_every_refiner_from_the_same_starts(tiny_run, tmp_path, capsys):
    starts = ("task.rotation_deg=[0,25]", "task.translation_mm=[0,200]", "task.perturbations=2")
    output = tmp_path / "maps"
    run_experiment(tiny_run, "basin", output, "task.compared=[pso,none]", "task.frames=1", *starts)
    assert (stages(output, reused=False), stages(output, reused=True)) == ({"basin": 2}, {})
    cells = {
        (r["refiner"], r["object"], float(r["rotation_deg"]), float(r["translation_mm"])): r
        for r in csv_rows(output / "basin.csv")
    }
    assert_targets_have_the_means_of_the_study(output, "basin")
    objects = {name for _, name, *_ in cells} - {"all"}
    targets = int(cells["pso", "all", 0.0, 0.0]["perturbations"]) // 2
    assert targets == len(objects) == 5
    assert all(cells["none", name, 0.0, 0.0]["right"] == "2" for name in objects)
    assert float(cells["pso", "all", 0.0, 0.0]["add_recall"]) >= 0.8
    pso, none = (float(cells[name, "all", 25.0, 0.0]["add_recall"]) for name in ("pso", "none"))
    assert pso > none + 0.2
    assert cells["none", "all", 0.0, 200.0]["right"] == "0"
    drawn = {path.stem for path in (output / "heatmaps").glob("*.png")}
    assert drawn == objects | {"all"} == {path.stem for path in (output / "heatmaps").glob("*.svg")}
    assert "perturbations each" in capsys.readouterr().out
    assert logged_metrics(tiny_run, output)["basin/none"] < 0.5


def test_a_refiner_that_is_added_leaves_the_others_as_they_are(tiny_run, tmp_path, monkeypatch):
    small = ("task.frames=1", "task.rotation_deg=[0]", "task.translation_mm=[0,10]")
    first, second = tmp_path / "first", tmp_path / "second"
    run_experiment(tiny_run, "basin", first, *small, "task.compared=[none]")
    monkeypatch.setattr(NoneRefiner, "refine", None)
    run_experiment(tiny_run, "basin", second, *small, "task.compared=[none,icp]")
    assert stages(second, reused=True).keys() == {"basin"}
    before, after = ((path / "basin.csv").read_text() for path in (first, second))
    assert after.startswith(before)
