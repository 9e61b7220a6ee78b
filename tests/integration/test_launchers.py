"""Arms of a sweep side by side, and as jobs of a cluster."""

import json
from importlib.util import find_spec

import pytest
from hydra import compose, initialize_config_dir
from mlflow import MlflowClient

from hlp.commands.composing import config_folder
from tiny_run import TinyRun, start_run


def needs(plugin: str) -> pytest.MarkDecorator:
    """Hydra takes long to say that a plugin is missing, so it is looked for here."""
    missing = find_spec("hydra_plugins") is None or find_spec(f"hydra_plugins.{plugin}") is None
    return pytest.mark.skipif(missing, reason=f"{plugin} is not installed")


@needs("hydra_submitit_launcher")
def test_slurm_is_told_what_an_arm_needs() -> None:
    chosen = ("hydra/launcher=slurm", "hydra.launcher.partition=cpu", "output=out")
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("config", overrides=list(chosen), return_hydra_config=True)
    launcher = config.hydra.launcher
    assert launcher._target_.endswith("SlurmLauncher")
    assert (launcher.partition, launcher.cpus_per_task, launcher.timeout_min) == ("cpu", 2, 720)


@needs("hydra_joblib_launcher")
@pytest.mark.slow
@pytest.mark.thorough
def test_arms_side_by_side_leave_what_arms_in_turn_leave(tiny_run: TinyRun) -> None:
    """Four processes at once, of which one has a wrong value: that one is a FAILED run."""
    swept = ("-m", *tiny_run.overrides, "panels=0", "refinement.particles=0,5,6,7", "output=cores")
    launcher = ("hydra/launcher=cores", "hydra.launcher.n_jobs=4")
    done = start_run(tiny_run.folder, *swept, *launcher, threads=1)
    assert done.returncode == 1
    assert "refinement.particles is 0" in done.stderr
    folder = tiny_run.folder / "cores"
    assert [(folder / arm / "manifest.json").is_file() for arm in "0123"] == [False, *[True] * 3]
    parent = json.loads((folder / "sweep.json").read_text())["run_id"]
    client = MlflowClient(f"sqlite:///{tiny_run.folder / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("demo")
    assert experiment is not None
    runs = client.search_runs([experiment.experiment_id])
    arms = [run for run in runs if run.data.tags.get("mlflow.parentRunId") == parent]
    found = {arm.data.params["refinement.particles"]: arm.info.status for arm in arms}
    assert found == {"0": "FAILED", **dict.fromkeys("567", "FINISHED")}
