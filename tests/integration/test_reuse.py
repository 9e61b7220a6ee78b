"""What a run finds on disk: reused stages, interrupted ones, crashes, the same poses again."""

import json
import re
import shutil
from pathlib import Path

import pytest

from hlp.errors import DataError, HlpError
from hlp.method.find.estimator import PoseEstimator
from run_files import logged_run, logged_runs, read_json, stages
from table_text import csv_rows
from tiny_run import start_run

pytestmark = pytest.mark.slow

LEARNT = {"views": 8, "classifier": 1, "encoder": 1, "codebook": 8}


def poses_without_times(path):
    return [{key: value for key, value in row.items() if key != "time"} for row in csv_rows(path)]


def statuses(folder):
    """Status of every MLflow run, by the name of its output folder."""
    _, found = logged_runs(folder)
    return {Path(run.data.tags["output"]).name: run.info.status for run in found}


def test_other_refinement_makes_only_poses_and_links_to_the_run_that_trained(tiny_run, call):
    code, said, _ = call(*tiny_run.overrides, "refinement.particles=15", "output=fewer")
    assert code == 0
    output = tiny_run.folder / "fewer"
    assert stages(output, reused=False) == {"poses": 1}
    assert stages(output, reused=True) == LEARNT | {"regions": 1, "hypotheses": 1}
    assert [line.split()[1] for line in said.splitlines() if line.startswith("made ")] == ["poses"]
    ours, theirs = (poses_without_times(path / "poses.csv") for path in (output, tiny_run.output))
    assert ours != theirs
    client, run = logged_run(tiny_run.folder, "fewer")
    words = run.data.tags["mlflow.note.content"]
    link = r"classifier trained by \[(.+)\]\(#/experiments/(\d+)/runs/(\w+)\?"
    ((name, experiment_id, run_id),) = re.findall(link, words)
    first = client.get_run(run_id)
    assert (first.info.run_name, first.info.experiment_id) == (name, experiment_id)
    assert first.data.tags["output"] == str(tiny_run.made_in / "first")
    assert run.data.tags["classifier_of_run"] == run_id
    assert len(client.get_metric_history(run_id, "classifier/loss")) == 1
    assert "classifier/loss" not in run.data.metrics


@pytest.mark.parametrize("error", [DataError("depth is odd"), ValueError("a bug")])
def test_crash_leaves_a_failed_run(tiny_run, call, monkeypatch, error):
    def fail(*_):
        raise error

    monkeypatch.setattr(PoseEstimator, "refine", fail)
    name = type(error).__name__
    overrides = (*tiny_run.overrides, "refinement.iterations=2", f"output={name}")
    if not isinstance(error, HlpError):  # a bug keeps its traceback
        with pytest.raises(ValueError, match="a bug"):
            call(*overrides)
    else:
        code, _, said = call(*overrides)
        assert code == 1
        assert said.startswith("hlp: depth is odd\nwhile making poses in ")
    assert statuses(tiny_run.folder)[name] == "FAILED"
    assert not (tiny_run.folder / name / "summary.json").exists()


@pytest.mark.thorough
def test_same_seed_same_poses_whatever_the_threads(tiny_run, tmp_path):
    """Everything is made again in another folder, by one thread instead of two."""
    again = start_run(tmp_path, *tiny_run.overrides, "output=again", threads=1)
    assert again.returncode == 0, again.stderr
    first, second = (
        {(event["stage"], event["of"]): event["fingerprint"] for event in manifest["stages"]}
        for manifest in (
            read_json(tiny_run.output / "manifest.json"),
            read_json(tmp_path / "again" / "manifest.json"),
        )
    )
    assert first == second
    ours = poses_without_times(tmp_path / "again" / "poses.csv")
    assert ours == poses_without_times(tiny_run.output / "poses.csv")
    scores = (tmp_path / "again" / "scores.csv").read_bytes()
    assert scores == (tiny_run.output / "scores.csv").read_bytes()


@pytest.fixture
def manifest(tiny_run, tmp_path):
    """The tiny run's manifest, in another place than the run."""
    return Path(shutil.copy(tiny_run.output / "manifest.json", tmp_path / "kept.json"))


@pytest.mark.thorough
def test_same_manifest_same_poses(tiny_run, call, manifest):
    """Refined anew, with one thread; what came before is on disk."""
    for folder in (tiny_run.folder / "work" / "poses").iterdir():
        if folder.is_dir():
            shutil.rmtree(folder)
    code, said, _ = call(f"manifest={manifest}", "output=repeated", "machine.threads=1")
    assert code == 0
    assert f"Repeated  the same poses as in {manifest}" in said
    assert "made   poses" in said
    again = tiny_run.folder / "repeated"
    ours, theirs = (poses_without_times(path / "poses.csv") for path in (again, tiny_run.output))
    assert ours == theirs
    before, after = read_json(manifest), read_json(again / "manifest.json")
    assert after["poses"] == before["poses"]
    assert after["config"]["machine"].pop("threads") == 1
    assert before["config"]["machine"].pop("threads") == 2
    del before["config"]["output"], after["config"]["output"]
    assert after["config"] == before["config"]


@pytest.mark.thorough
def test_other_poses_and_other_code_are_said(tiny_run, call, manifest):
    changed = read_json(manifest)
    changed |= {"code": "0" * 16, "poses": "0" * 16}
    changed["versions"]["numpy"] = "1.0"
    changed["processor"]["type"] = "abacus"
    changed["builds"]["torch"] = "0" * 16
    manifest.write_text(json.dumps(changed))
    code, said, _ = call(f"manifest={manifest}", "output=other")
    assert code == 0
    assert f"HLP's code is not that of {manifest}" in said
    assert f"and 1.0 in {manifest}" in said
    assert f"processor: type differ from {manifest}" in said
    assert f"builds: torch differ from {manifest}" in said
    assert f"NOT the same poses as in {manifest}" in said


@pytest.mark.thorough
def test_what_cannot_be_repeated_stops_before_any_stage(call, manifest):
    code, said, error = call(f"manifest={manifest}", "refinement=icp")
    assert (code, said) == (1, "")
    assert "refinement=icp: " in error
    changed = read_json(manifest)
    changed["data"]["frames"] = "other"
    manifest.write_text(json.dumps(changed))
    code, said, error = call(f"manifest={manifest}", "output=never")
    assert (code, said) == (1, "")
    assert f"not the data of {manifest}: frames differ" in error
    manifest.write_text("{}")
    assert "not a manifest of a run" in call(f"manifest={manifest}")[2]
    assert "there is no file " in call(f"manifest={manifest.parent / 'absent.json'}")[2]
