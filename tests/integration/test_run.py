"""The whole pipeline through the command line: a tiny run of the demo world and its results."""

import csv
import json
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mlflow import MlflowClient

from hlp.data.synthetic_objects import demo_objects
from hlp.data.synthetic_scenes import SyntheticScenes, SyntheticSettings
from hlp.pipeline.detector import Detector
from hlp.records import Target
from tiny_run import TinyRun, start_run

Row = dict[str, str]
Call = Callable[..., tuple[int, str, str]]

METRICS = ("add", "5cm5deg", "iou50")
VERDICTS = {"add": "ad_correct", "5cm5deg": "pose_correct", "iou50": "box_correct"}
LEARNT = {"views": 8, "classifier": 1, "encoder": 1, "codebook": 8}
FOUND = {"regions": 1, "hypotheses": 1, "poses": 1}


def rows(path: Path) -> list[Row]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def read_json(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def target_of(row: Row) -> tuple[int, int, int]:
    return int(row["scene_id"]), int(row["im_id"]), int(row["obj_id"])


def stages(output: Path, *, reused: bool) -> dict[str, int]:
    """How many outputs of each stage a run reused or made, by its manifest."""
    counts: dict[str, int] = {}
    for event in read_json(output / "manifest.json")["stages"]:
        if event["reused"] == reused:
            counts[event["stage"]] = counts.get(event["stage"], 0) + 1
    return counts


def poses_without_times(path: Path) -> list[Row]:
    return [{key: value for key, value in row.items() if key != "time"} for row in rows(path)]


def statuses(folder: Path) -> dict[str, str]:
    """Status of every MLflow run, by the name of its output folder."""
    client = MlflowClient(f"sqlite:///{folder / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("hlp")
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id])
    return {run.info.run_name.split()[-1]: run.info.status for run in found}


@pytest.fixture(scope="module")
def truth() -> dict[tuple[int, int, int], Target]:
    """Targets of the two frames, from the demo world itself (frames 0 and 12 of its 24)."""
    scenes = SyntheticScenes(
        SyntheticSettings(
            24, 0, 320, 240, 1.0, 0.3, (5, 5), (1, 3), (600.0, 1100.0), (20.0, 75.0), 20.0, 5.0
        )
    )
    frames = [scenes.load(scenes.keys[number]) for number in (0, 12)]
    return {
        (frame.scene_id, frame.frame_id, target.object_id): target
        for frame in frames
        for target in frame.targets
    }


def test_summary_says_what_the_scores_say(tiny_run: TinyRun) -> None:
    summary = read_json(tiny_run.output / "summary.json")
    scores = rows(tiny_run.output / "scores.csv")
    assert {"targets", "metrics", "per_object", "timing_ms", "waterfall"} <= summary.keys()
    assert summary["targets"] == len(scores)
    assert tuple(summary["metrics"]) == METRICS
    for metric, verdict in VERDICTS.items():
        right = [int(row[verdict]) for row in scores]
        low, high = summary["metrics"][metric]["ci95"]
        assert summary["metrics"][metric]["recall"] == pytest.approx(np.mean(right))
        assert 0.0 <= low <= np.mean(right) <= high <= 1.0
    assert summary["per_object"].keys() == {row["object"] for row in scores}
    for name, found in summary["per_object"].items():
        own = [row for row in scores if row["object"] == name]
        assert found["targets"] == len(own)
        for metric, verdict in VERDICTS.items():
            expected = np.mean([int(row[verdict]) for row in own])
            assert found[metric] == {"recall": pytest.approx(expected)}
    lost = Counter(row["cause"] for row in scores if not int(row["ad_correct"]))
    total = summary["waterfall"]["total"]
    assert "" not in lost and lost.keys() <= total.keys()
    assert total == {**dict.fromkeys(total, 0), **lost, "correct": len(scores) - lost.total()}
    assert summary["votes"]["per_object"].keys() == summary["per_object"].keys()
    assert summary["votes"]["total"]["votes"] > 0
    assert summary["timing_ms"].keys() == {"total", "holistic", "local", "voting", "refinement"}
    for time in summary["timing_ms"].values():
        assert 0.0 < time["median"] <= time["p95"]


def test_scores_have_one_row_a_target(
    tiny_run: TinyRun, truth: dict[tuple[int, int, int], Target]
) -> None:
    scores = rows(tiny_run.output / "scores.csv")
    assert [target_of(row) for row in scores] == sorted(truth)
    names = {object_id: model.name for object_id, model in demo_objects().items()}
    for row in scores:
        assert row["object"] == names[int(row["obj_id"])]
        seen = truth[target_of(row)].visible_fraction
        assert float(row["visible_fraction"]) == pytest.approx(seen)


def test_poses_are_in_bops_format_and_give_the_scores(
    tiny_run: TinyRun, truth: dict[tuple[int, int, int], Target]
) -> None:
    """R, t in millimetres, and the errors in scores.csv follow from them and the true poses."""
    path = tiny_run.output / "poses.csv"
    assert path.read_text().splitlines()[0] == "scene_id,im_id,obj_id,score,R,t,time"
    models = demo_objects()
    poses = {target_of(row): row for row in rows(path)}
    assert poses.keys() <= truth.keys()
    checked = 0
    for row in rows(tiny_run.output / "scores.csv"):
        target = target_of(row)
        assert int(row["found"]) == (target in poses)
        if target not in poses:
            continue
        rotation = np.array([float(word) for word in poses[target]["R"].split()]).reshape(3, 3)
        translation = np.array([float(word) for word in poses[target]["t"].split()])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        assert 100.0 < translation[2] < 10_000.0  # mm: no scene is deeper
        assert 0.0 <= float(poses[target]["score"]) <= 1.0
        true = truth[target].pose_cam_obj
        off = np.linalg.norm(translation - 1000.0 * true[:3, 3])
        assert float(row["translation_mm"]) == pytest.approx(off, abs=1e-6)
        if row["object"] != "bowl":  # symmetric by the policy: ADI
            vertices = models[target[2]].mesh.vertices.astype(np.float64)
            moved = 1000.0 * vertices @ rotation.T + translation
            meant = 1000.0 * (vertices @ true[:3, :3].T + true[:3, 3])
            error = np.linalg.norm(moved - meant, axis=1).mean()
            assert float(row["ad_mm"]) == pytest.approx(error, abs=1e-3)
            limit = 100.0 * models[target[2]].diameter
            assert int(row["ad_correct"]) == (error < limit)
            checked += 1
    assert checked >= 3
    for scene in {row["scene_id"] for row in poses.values()}:  # BOP: one time an image
        times = {row["time"] for row in poses.values() if row["scene_id"] == scene}
        assert len(times) == 1
        assert 0.0 < float(times.pop()) < 600.0


def test_manifest_says_what_made_the_result(tiny_run: TinyRun) -> None:
    manifest = read_json(tiny_run.output / "manifest.json")
    assert manifest["seed"] == 0
    assert manifest["config"]["patches"]["pool"]["per_object"] == 60
    assert manifest["versions"]["numpy"] == np.__version__
    assert len(manifest["code"]) == 16
    data = manifest["data"]
    assert data["keys"] == ["000000_000000", "000012_000000"]
    assert data["models"].keys() == {model.name for model in demo_objects().values()}
    assert all(data[key] for key in ("frames", "photographs", "background_frames"))
    assert stages(tiny_run.output, reused=False) == LEARNT | FOUND
    assert stages(tiny_run.output, reused=True) == {}


def test_panels_are_pictures(tiny_run: TinyRun) -> None:
    (path,) = (tiny_run.output / "panels").iterdir()
    assert path.name.startswith("000000_000000_")
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape[0] >= 2 * 240
    assert picture.shape[1] == 2 * 320
    assert picture.std() > 10


def test_console_tells_the_stages_and_where_the_results_are(tiny_run: TinyRun) -> None:
    said = tiny_run.process.stdout
    assert tiny_run.process.stderr == ""
    assert said.count("made   views of ") == 8
    assert said.count("made   codebook of ") == 8
    assert said.count("made   regions ") == 1
    assert "reused" not in said
    own = ("made ", "cutting ")
    log = said[: said.index("Recall")].splitlines()
    assert [line for line in log if not line.startswith(own)] == []
    assert str(tiny_run.output) in said
    assert f"sqlite:///{tiny_run.folder / 'work' / 'mlflow.db'}" in said


def test_mlflow_has_the_run_with_all_of_it(tiny_run: TinyRun) -> None:
    client = MlflowClient(f"sqlite:///{tiny_run.folder / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("hlp")
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id])
    (run,) = [each for each in found if each.info.run_name == "demo pca joint first"]
    summary = read_json(tiny_run.output / "summary.json")
    assert run.info.status == "FINISHED"
    assert run.data.params["encoder.name"] == "pca"
    assert run.data.params["rendering.viewpoints"] == "24"
    assert run.data.metrics["add/recall"] == summary["metrics"]["add"]["recall"]
    assert run.data.metrics["time_ms/total"] == summary["timing_ms"]["total"]["median"]
    assert len(client.get_metric_history(run.info.run_id, "classifier/loss")) == 1
    artifacts = {item.path for item in client.list_artifacts(run.info.run_id)}
    wanted = {"summary.json", "scores.csv", "poses.csv", "manifest.json", "panels", "config.yaml"}
    assert artifacts >= wanted
    tables = {item.path for item in client.list_artifacts(run.info.run_id, "tables")}
    assert tables == {"tables/objects.json", "tables/targets.json"}
    inputs = {each.dataset.name: each.dataset.digest for each in run.inputs.dataset_inputs}
    data = read_json(tiny_run.output / "manifest.json")["data"]
    assert inputs["synthetic frames"] == data["frames"]
    assert all(inputs[f"model of {name}"] == digest for name, digest in data["models"].items())


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


def test_interrupted_stage_goes_on_where_it_stopped(
    tiny_run: TinyRun, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C in the second frame: the next run refines that frame only, to the same poses."""
    overrides = (*tiny_run.overrides, "refinement.particles=5", "refinement.iterations=3")
    fine = Detector.fine
    asked: list[int] = []

    def interrupted(self: Detector, frame: Any, object_id: int, coarse: Any) -> Any:
        if frame.scene_id == 12:
            raise KeyboardInterrupt
        return fine(self, frame, object_id, coarse)

    def counted(self: Detector, frame: Any, object_id: int, coarse: Any) -> Any:
        asked.append(frame.scene_id)
        return fine(self, frame, object_id, coarse)

    monkeypatch.setattr(Detector, "fine", interrupted)
    code, _, error = call(*overrides, "output=interrupted")
    assert code == 130
    assert "Traceback" not in error
    assert statuses(tiny_run.folder)["interrupted"] == "KILLED"
    (partial,) = (tiny_run.folder / "work" / "poses").glob("*.partial")
    assert [path.name for path in partial.iterdir()] == ["000000_000000.npz"]
    monkeypatch.setattr(Detector, "fine", counted)
    assert call(*overrides, "output=resumed")[0] == 0
    assert set(asked) == {12}
    assert not partial.exists()
    shutil.rmtree(partial.with_suffix(""))
    asked.clear()
    assert call(*overrides, "output=whole")[0] == 0
    assert set(asked) == {0, 12}
    assert poses_without_times(tiny_run.folder / "resumed" / "poses.csv") == poses_without_times(
        tiny_run.folder / "whole" / "poses.csv"
    )


@pytest.mark.parametrize("error", [ValueError("depth is odd"), RuntimeError("a bug")])
def test_crash_leaves_a_failed_run(
    tiny_run: TinyRun, call: Call, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: Any) -> None:
        raise error

    monkeypatch.setattr(Detector, "fine", fail)
    name = type(error).__name__
    overrides = (*tiny_run.overrides, "refinement.iterations=2", f"output={name}")
    if isinstance(error, RuntimeError):  # a bug keeps its traceback
        with pytest.raises(RuntimeError, match="a bug"):
            call(*overrides)
    else:
        code, _, said = call(*overrides)
        assert code == 1
        assert said.startswith("hlp: depth is odd\nwhile making poses in ")
    assert statuses(tiny_run.folder)[name] == "FAILED"
    assert not (tiny_run.folder / name / "summary.json").exists()


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


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A data set without any mesh."""
    for folder in ("models", "test", "photos", "rooms"):
        (tmp_path / "lm" / folder).mkdir(parents=True)
    return tmp_path / "lm"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["sede=1"], ["sede"]),
        (["refinement.partikles=3"], ["refinement.partikles"]),
        (["+data.foo=1"], ["data.foo", "given: 1"]),
        (["rendering.viewpoints=three"], ["rendering.viewpoints", "valid integer", "'three'"]),
        (["encoder=none"], ["encoder/none", "contrastive"]),
        (["frames=0"], ["frames is 0"]),
        (["refinement.particles=0"], ["refinement.particles is 0", "at least 1"]),
        (["refinement.phi_1=1.0"], ["refinement.phi_1 + phi_2", "above 4"]),
        (["experiment=lm_board"], ["data.root is not set"]),
        (["experiment=lm_board", "data.root=nowhere"], ["data.root is no folder", "nowhere"]),
        (
            [
                "experiment=lm_board",
                "data.root={root}",
                "data.photographs=null",
                "data.rooms=null",
                "data.rgbd_frames=null",
            ],
            ["no mesh of object 1 (ape)", "obj_000001.ply"],
        ),
    ],
)
def test_wrong_input_is_named_before_any_stage(
    call: Call,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    overrides: list[str],
    words: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said, error = call(*[each.format(root=dataset) for each in overrides])
    assert code in {1, 2}
    assert said == ""
    assert error.startswith("hlp: ")
    assert error.count("hlp: ") == 1
    assert len(error.splitlines()) <= 12
    for word in words:
        assert word in error
    for word in ("Traceback", "pydantic", "input_value", "full_key"):
        assert word not in error
    assert not (tmp_path / "work").exists()
