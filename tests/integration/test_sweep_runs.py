"""Sweeps of the tiny run's refiner: what MLflow has of them, and what an interruption costs."""

from importlib.util import find_spec
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

from hlp.commands import report
from hlp.commands.composing import config_folder
from run_files import children_of, read_json
from table_text import csv_rows
from tiny_run import start_run


def needs(plugin):
    """Hydra takes long to say that a plugin is missing, so it is looked for here."""
    missing = find_spec("hydra_plugins") is None or find_spec(f"hydra_plugins.{plugin}") is None
    return pytest.mark.skipif(missing, reason=f"{plugin} is not installed")


@pytest.mark.slow
def test_failed_arm_is_a_failed_run_and_the_others_go_on(tiny_run, call):
    """No particles: refused before any stage. The next run of the sweep is not stopped by it."""
    code, _, error = call("-m", *tiny_run.overrides, "refinement.particles=0,5", "output=failing")
    assert code == 1
    assert "refinement.particles is 0" in error
    output = tiny_run.folder / "failing"
    client, parent, children = children_of(tiny_run.folder, output)
    assert parent.info.status == "FAILED"
    assert parent.info.run_name == "sweep of particles"
    assert set(parent.data.params) == {setting.partition("=")[0] for setting in tiny_run.overrides}
    named = [(child.info.run_name, child.info.status) for child in children]
    assert named == [("particles 0", "FAILED"), ("particles 5", "FINISHED")]
    assert [child.data.params["refinement.particles"] for child in children] == ["0", "5"]
    traceback = Path(
        client.download_artifacts(children[0].info.run_id, "traceback.txt")
    ).read_text()
    assert "refinement.particles is 0" in traceback
    whole = Path(client.download_artifacts(children[1].info.run_id, "config.yaml")).read_text()
    assert "particles: 5" in whole
    summary = read_json(output / "1" / "summary.json")
    assert children[1].data.metrics["add"] == round(summary["metrics"]["add"]["recall"], 4)


@pytest.mark.slow
def test_a_sweep_of_studies_ends_with_table_figure_and_page(tiny_run, call):
    """Also if a run failed: no particles."""
    given = ("task=oracle", "task.frames=1", "refinement.particles=0,5,6", "output=oracles")
    code, said, error = call(*tiny_run.overrides, "-m", *given)
    assert code == 1 and "refinement.particles is 0" in error
    folder = tiny_run.folder / "oracles"
    words = " ".join(said.split())
    assert "oracle by particles: 2 of 3 runs finished; best by est/est: " in words
    assert "without a result: particles 0 (see 0/hlp.log)." in words
    assert "to first" in words  # the default was not among the finished runs
    endings = ("md", "csv", "png", "svg")
    written = {"report.html", *(f"oracle.{ending}" for ending in endings)}
    assert written <= {path.name for path in folder.iterdir()}
    assert '<a href="2/report.html">' in (folder / "report.html").read_text()
    client, parent, _ = children_of(tiny_run.folder, folder)
    assert written <= {item.path for item in client.list_artifacts(parent.info.run_id)}
    assert "2 of 3 runs finished" in parent.data.tags["mlflow.note.content"]
    assert parent.data.tags["best_run"].startswith(("particles 5", "particles 6"))
    history = client.get_metric_history(parent.info.run_id, "sweep/oracle/est/est")
    assert [point.step for point in history] == [5, 6]


@pytest.mark.slow
@pytest.mark.thorough
def test_sweep_and_report_write_the_papers_figure(tiny_run, call, capsys):
    """Refined poses, and coarse ones; nothing is learnt again for either."""
    given = ("experiment=pso_vs_icp", "refinement=icp,none", "output=outputs/pso_vs_icp/tiny")
    code, _, error = call(*tiny_run.overrides, *given)
    assert code == 0, error
    folder = tiny_run.folder / "outputs" / "pso_vs_icp" / "tiny"
    found = csv_rows(folder / "pso_vs_icp.csv")
    assert [row["refinement"] for row in found] == ["icp", "none"]
    assert found[0]["targets"] == found[1]["targets"]
    (folder / "pso_vs_icp.svg").unlink()
    report.report(["experiment=pso_vs_icp"])
    printed = capsys.readouterr().out
    assert "PSO against ICP" in printed
    assert "in 2 frames of synthetic data" in printed
    assert (folder / "pso_vs_icp.svg").is_file()


@needs("hydra_joblib_launcher")
@pytest.mark.slow
@pytest.mark.thorough
def test_settings_side_by_side_leave_what_settings_in_turn_leave(tiny_run):
    """Four processes at once, of which one has a wrong value: that one is a FAILED run."""
    swept = ("-m", *tiny_run.overrides, "panels=0", "refinement.particles=0,5,6,7", "output=cores")
    launcher = ("hydra/launcher=cores", "hydra.launcher.n_jobs=4")
    done = start_run(tiny_run.folder, *swept, *launcher, threads=1)
    assert done.returncode == 1
    assert "refinement.particles is 0" in done.stderr
    folder = tiny_run.folder / "cores"
    assert [(folder / name / "manifest.json").is_file() for name in "0123"] == [False, *[True] * 3]
    _, _, children = children_of(tiny_run.folder, folder)
    found = {child.data.params["refinement.particles"]: child.info.status for child in children}
    assert found == {"0": "FAILED", **dict.fromkeys("567", "FINISHED")}


@needs("hydra_submitit_launcher")
def test_slurm_is_told_what_a_run_needs():
    chosen = ["hydra/launcher=slurm", "hydra.launcher.partition=cpu", "output=out"]
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        launcher = compose("config", overrides=chosen, return_hydra_config=True).hydra.launcher
    assert launcher._target_.endswith("SlurmLauncher")
    assert (launcher.partition, launcher.cpus_per_task, launcher.timeout_min) == ("cpu", 2, 720)
