"""The whole pipeline through the command line: a tiny run of the demo dataset and its results."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.evaluation.summary import summarise
from hlp.refinement.refiner import cost_around
from hlp.refinement.verification import observe
from hlp.results.poses_file import read_poses, read_scores
from hlp.runs.runner import stages_of
from hlp.runs.stage_samples import FrameResults, search_again
from hlp.stages.manifest import library_builds, processor
from hlp.stages.store import StageStore
from run_files import logged_run, read_json, stages
from same_answers import compare_answers
from table_text import csv_rows

LEARNT = {"views": 8, "classifier": 1, "encoder": 1, "codebook": 8}
FOUND = {"regions": 1, "hypotheses": 1, "poses": 1}


def target_of(row):
    return int(row["scene_id"]), int(row["im_id"]), int(row["obj_id"])


def test_summary_says_what_the_scores_say(tiny_run):
    summary = read_json(tiny_run.output / "summary.json")
    scores, names = read_scores(tiny_run.output / "scores.csv")
    settings = tiny_run.build().settings
    said = summarise(scores, names, {"total": []}, {}, settings.evaluation, settings.seed)
    for part in ("targets", "metrics", "per_object", "waterfall"):
        assert summary[part] == json.loads(json.dumps(said[part])), part
    assert all(bool(score.cause) != score.add_correct for score in scores)
    assert summary["votes"]["per_object"].keys() == summary["per_object"].keys()
    assert summary["votes"]["total"]["votes"] > 0
    assert summary["timing_ms"].keys() == {"total", "holistic", "local", "voting", "refinement"}
    for time in summary["timing_ms"].values():
        assert 0.0 < time["median"] <= time["p95"]
    timing = summary["timing"]
    assert (timing["frames"], timing["reused_stages"]) == (2, [])
    assert timing["objects"] == summary["targets"]
    assert timing["first_use_seconds"] > 0.0


def test_poses_give_the_scores_of_every_target(tiny_run):
    """Against the true poses of the demo itself, in the frames 0 and 12 of its 24."""
    settings = SyntheticSettings(width=320, height=240, objects=(5, 5), clutter=(1, 3))
    scenes, models = SyntheticScenes(settings), demo_objects()
    frames = [scenes.load(scenes.keys[number]) for number in (0, 12)]
    truths = [FrameTruth.of(frame, with_depth=True) for frame in frames]
    poses = read_poses(tiny_run.output / "poses.csv")
    expected = score_targets(truths, models, poses, tiny_run.build().settings.evaluation)
    scores, names = read_scores(tiny_run.output / "scores.csv")
    assert names == {score.object_id: models[score.object_id].name for score in expected}
    for ours, theirs in zip(scores, expected, strict=True):
        stated = asdict(replace(theirs, cause=ours.cause))
        assert asdict(ours) == pytest.approx(stated, nan_ok=True)
    assert len(poses) == sum(score.found for score in scores) >= 3
    assert all(0.0 <= pose.score <= 1.0 for pose in poses)
    times = {(pose.scene_id, pose.seconds["total"]) for pose in poses}  # BOP: one an image
    assert len(times) == 2 and all(0.0 < seconds < 600.0 for _, seconds in times)


def test_manifest_says_what_made_the_result(tiny_run):
    manifest = read_json(tiny_run.output / "manifest.json")
    assert manifest["seed"] == 0
    assert manifest["config"]["patches"]["pool"]["per_object"] == 60
    assert manifest["versions"]["numpy"] == np.__version__
    assert len(manifest["code"]) == 16
    assert manifest["processor"] == processor()
    assert manifest["builds"] == library_builds()
    data = manifest["data"]
    assert data["keys"] == ["000000_000000", "000012_000000"]
    assert data["models"].keys() == {model.name for model in demo_objects().values()}
    assert all(data[key] for key in ("frames", "photographs", "background_frames"))
    assert stages(tiny_run.output, reused=False) == LEARNT | FOUND
    assert stages(tiny_run.output, reused=True) == {}


def test_panels_are_pictures(tiny_run):
    poses, target = sorted(
        (tiny_run.output / "panels").iterdir(), key=lambda p: "_poses" not in p.name
    )
    assert poses.name == "000000_000000_poses.jpg"
    assert target.name.startswith("000000_000000_")
    for path, across, down in ((poses, 1, 1), (target, 2, 2)):
        picture = cv2.imread(str(path))
        assert picture.shape[0] >= down * 240
        assert picture.shape[1] == across * 320
        assert picture.std() > 10
        assert path.stat().st_size < 200_000


def test_a_run_draws_what_each_stage_works_with(tiny_run):
    drawn = list((tiny_run.output / "stages").iterdir())
    pictures = {"viewpoints", "views", "training_windows", "nearest_entries", "swarm_costs"}
    assert {path.stem for path in drawn} == pictures
    for path in drawn:
        assert path.suffix == ".jpg" and path.stat().st_size < 400_000
        assert min(cv2.imread(str(path)).shape[:2]) > 100


def test_swarms_are_searched_again_from_where_they_began(tiny_run):
    run = tiny_run.build("machine.threads=1")
    detection = stages_of(run, StageStore(tiny_run.folder / "work"))
    found, settings = FrameResults.read(detection, [], detection.keys[0]), run.settings.refinement
    frame = found.frame
    seen = observe(frame.rgb, frame.depth, frame.camera_matrix, settings.verification)
    for target in frame.targets:
        refined, model = found.trace[target.object_id].refined, run.dataset.models[target.object_id]
        for start in refined.starts[:2]:
            rounds = search_again(settings, found, model, start)
            assert len(rounds) > 1 and rounds.shape[1] == 25
            coarse = cost_around(model, seen, start, settings.cost).evaluate(start[None])[0]
            swarm_alone = search_again(replace(settings, descent=None), found, model, start)
            assert rounds[0, 0] <= coarse == swarm_alone[0, 0]


def test_a_detector_finds_the_same_poses(tiny_run, tmp_path):
    work = f"work={tiny_run.folder / 'work'}"
    overrides = (*tiny_run.overrides, work)
    assert compare_answers(overrides, tiny_run.output, tmp_path / "learnt", frames=1) >= 4


def test_console_tells_the_stages_and_where_the_results_are(tiny_run):
    said = tiny_run.out
    assert tiny_run.error == ""
    assert said.count("made   views of ") == 8
    assert said.count("made   codebook of ") == 8
    assert said.count("made   regions ") == 1
    assert "reused" not in said
    own = ("made ", "drawn ", "step ")
    log = said[: said.index("Recall")].splitlines()
    others = [line for line in log if not line.startswith(own)]
    assert [line for line in others if not line.endswith(" left")] == []  # of slow machines
    assert str(tiny_run.made_in / "first") in said
    assert str(Path("first") / "stages") in said
    assert "Times: measured by this run on 2 frames." in said
    assert f"sqlite:///{tiny_run.made_in / 'work' / 'mlflow.db'}" in said


def test_mlflow_has_the_run_with_all_of_it(tiny_run):
    client, run = logged_run(tiny_run.folder, tiny_run.made_in / "first")
    summary = read_json(tiny_run.output / "summary.json")
    assert run.info.status == "FINISHED"
    assert run.info.run_name.startswith("pca, width 320")
    assert run.data.params["encoder"] == "pca"
    assert run.data.params["rendering.viewpoints"] == "20"
    assert not {"work", "output", "seed"} & set(run.data.params)
    assert (run.data.tags["encoder"], run.data.tags["refinement"]) == ("pca", "pso")
    assert "encoder=pca" in run.data.tags["command"]
    assert run.data.metrics["add"] == round(summary["metrics"]["add"]["recall"], 4)
    assert run.data.metrics["ms"] == round(summary["timing_ms"]["total"]["median"], 1)
    assert len(client.get_metric_history(run.info.run_id, "classifier/loss")) == 1
    for name in ("cpu_cores", "memory_megabytes"):
        assert client.get_metric_history(run.info.run_id, f"system/{name}") != []
    artifacts = {item.path for item in client.list_artifacts(run.info.run_id)}
    files = {"summary.json", "scores.csv", "poses.csv", "manifest.json", "config.yaml"}
    assert artifacts >= files | {"panels", "stages"}
    inputs = {used.dataset.name: used.dataset.digest for used in run.inputs.dataset_inputs}
    data = read_json(tiny_run.output / "manifest.json")["data"]
    assert inputs["synthetic frames"] == data["frames"]
    assert all(inputs[f"model of {name}"] == digest for name, digest in data["models"].items())


def test_the_report_shows_every_target_and_stands_alone(tiny_run):
    page = (tiny_run.output / "report.html").read_text()
    index = read_json(tiny_run.output / "report" / "index.json")
    scores = csv_rows(tiny_run.output / "scores.csv")
    shown = {tuple(target["key"][:3]) for target in index["targets"]}
    missed = {target_of(row) for row in scores if not int(row["add_correct"])}
    assert missed <= shown <= set(map(target_of, scores))
    for target in index["targets"]:
        assert cv2.imread(str(tiny_run.output / "report" / target["picture"])) is not None
    assert f"of {len(scores)} targets have a right pose" in page
    assert 'src="http' not in page and 'href="http' not in page
    assert len(page) < 15e6


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["refinement.partikles=3"], ["refinement.partikles"]),
        (["encoder=none"], ["Could not find 'encoder/none'", "contrastive"]),
        (["experiment=linemod_bop", "data.root=nowhere"], ["data.root is not a folder", "nowhere"]),
    ],
)
def test_wrong_input_is_named_before_any_stage(call, tmp_path, monkeypatch, overrides, words):
    monkeypatch.chdir(tmp_path)
    code, said, error = call(*overrides)
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
