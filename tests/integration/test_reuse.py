"""What a run finds on disk: reused stages, interrupted ones, crashes, the same poses again."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mlflow import MlflowClient

from hlp.data.synthetic.scenes import SyntheticScenes
from hlp.errors import DataError, HlpError
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.records import Frame
from run_files import Row, read_json, rows, stages
from tiny_run import TinyRun, start_run

pytestmark = pytest.mark.slow

Call = Callable[..., tuple[int, str, str]]

LEARNT = {"views": 8, "classifier": 1, "encoder": 1, "codebook": 8}


def poses_without_times(path: Path) -> list[Row]:
    return [{key: value for key, value in row.items() if key != "time"} for row in rows(path)]


def statuses(folder: Path) -> dict[str, str]:
    """Status of every MLflow run, by the name of its output folder."""
    client = MlflowClient(f"sqlite:///{folder / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("demo")
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id])
    return {Path(run.data.tags["output"]).name: run.info.status for run in found}


def test_other_refinement_makes_only_poses(tiny_run: TinyRun, call: Call) -> None:
    code, said, _ = call(*tiny_run.overrides, "refinement.particles=15", "output=fewer")
    assert code == 0
    output = tiny_run.folder / "fewer"
    assert stages(output, reused=False) == {"poses": 1}
    assert stages(output, reused=True) == LEARNT | {"regions": 1, "hypotheses": 1}
    assert [line.split()[1] for line in said.splitlines() if line.startswith("made ")] == ["poses"]
    assert poses_without_times(output / "poses.csv") != poses_without_times(
        tiny_run.output / "poses.csv"
    )


def test_a_run_links_to_the_one_that_trained_its_networks(tiny_run: TinyRun, call: Call) -> None:
    assert call(*tiny_run.overrides, "refinement.particles=14", "output=linked")[0] == 0
    client = MlflowClient(f"sqlite:///{tiny_run.folder / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("demo")
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id])
    (run,) = [each for each in found if Path(each.data.tags["output"]).name == "linked"]
    words = run.data.tags["mlflow.note.content"]
    (link,) = re.findall(r"classifier trained by \[(.+)\]\(#/experiments/(\d+)/runs/(\w+)\?", words)
    name, experiment_id, run_id = link
    first = client.get_run(run_id)
    assert (first.info.run_name, first.info.experiment_id) == (name, experiment_id)
    assert first.data.tags["output"] == str(tiny_run.made_in / "first")
    assert run.data.tags["classifier_of_run"] == run_id
    assert len(client.get_metric_history(run_id, "classifier/loss")) == 1
    assert "classifier/loss" not in run.data.metrics


def test_a_run_decodes_every_frame_once(
    tiny_run: TinyRun, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Detection, scores and causes of misses share one decode, found or not.

    Only panels, report and pictures of the stages, which show chosen frames and targets, decode
    these again.
    """
    decoded: list[str] = []
    load = SyntheticScenes.load

    def counted(self: SyntheticScenes, key: str) -> Frame:
        if self._targets:  # the others are rooms, for training
            decoded.append(key)
        return load(self, key)

    monkeypatch.setattr(SyntheticScenes, "load", counted)
    overrides = (*tiny_run.overrides, "patches.region.threshold=0.6", "panels=2")
    assert call(*overrides, "output=decoded")[0] == 0
    output = tiny_run.folder / "decoded"
    assert stages(output, reused=False) == {"regions": 1, "hypotheses": 1, "poses": 1}
    waterfall = read_json(output / "summary.json")["waterfall"]["total"]
    assert waterfall["correct"] < sum(waterfall.values())  # there are misses to explain
    assert len([*(output / "panels").iterdir()]) == 4  # all poses, and the panels of a target
    assert decoded[:2] == ["000000_000000", "000012_000000"]
    assert max(map(decoded[2:].count, decoded), default=0) <= 3


@pytest.mark.thorough
def test_interrupted_stage_goes_on_where_it_stopped(
    tiny_run: TinyRun, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C in the second frame: the next run refines that frame only, to the same poses."""
    overrides = (*tiny_run.overrides, "refinement.particles=5", "refinement.iterations=3")
    refine = PoseEstimator.refine

    def interrupted(self: PoseEstimator, context: FrameContext, *given: Any) -> Any:
        if context.frame.scene_id == 12:
            raise KeyboardInterrupt
        return refine(self, context, *given)

    monkeypatch.setattr(PoseEstimator, "refine", interrupted)
    code, _, error = call(*overrides, "output=interrupted")
    assert code == 130
    assert "Traceback" not in error
    assert statuses(tiny_run.folder)["interrupted"] == "KILLED"
    (partial,) = (tiny_run.folder / "work" / "poses").glob("*.partial")
    (first,) = partial.iterdir()
    assert first.name == "000000_000000.npz"
    written = first.stat().st_mtime_ns
    monkeypatch.setattr(PoseEstimator, "refine", refine)
    assert call(*overrides, "output=resumed")[0] == 0
    assert not partial.exists()
    finished = partial.with_suffix("")
    assert (finished / first.name).stat().st_mtime_ns == written  # not made again
    assert (finished / "000012_000000.npz").stat().st_mtime_ns > written
    assert read_json(tiny_run.folder / "resumed" / "summary.json")["timing"]["reused_stages"] == [
        "regions",
        "hypotheses",
        "poses",
    ]
    shutil.rmtree(finished)
    assert call(*overrides, "output=whole")[0] == 0
    assert poses_without_times(tiny_run.folder / "resumed" / "poses.csv") == poses_without_times(
        tiny_run.folder / "whole" / "poses.csv"
    )


@pytest.mark.parametrize("error", [DataError("depth is odd"), ValueError("a bug")])
def test_crash_leaves_a_failed_run(
    tiny_run: TinyRun, call: Call, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: Any) -> None:
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
def test_same_seed_same_poses_whatever_the_threads(tiny_run: TinyRun, tmp_path: Path) -> None:
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
