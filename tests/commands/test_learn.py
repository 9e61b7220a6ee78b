"""What a run has learnt, as a folder that detectors and MLflow's models are made of."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hlp import Detector
from hlp.cli import main
from hlp.codebook.entries import load_codebook
from hlp.codebook.inverted_lists import JointListsSettings
from hlp.commands.composing import compose_config
from hlp.commands.learn import learnt_of_run
from hlp.config.build import Run, build_run
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.method.learn.learnt_folder import LearntFolder, check_files
from hlp.stages.manifest import named_outputs
from tiny_run import TinyRun

pytestmark = pytest.mark.slow


@pytest.fixture
def exported(tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tiny_run.folder)
    main(["objects", "export", "first", str(tmp_path / "learnt")])
    return tmp_path / "learnt"


@pytest.fixture
def run(tiny_run: TinyRun, monkeypatch: pytest.MonkeyPatch) -> Run:
    """The tiny run, built again where it was made."""
    monkeypatch.chdir(tiny_run.folder)
    return build_run(compose_config(*tiny_run.overrides, f"output={tiny_run.output}"))


def test_a_folder_holds_what_the_run_has_learnt(tiny_run: TinyRun, exported: Path) -> None:
    learnt = LearntFolder(exported)
    check_files(exported, learnt.record)
    events = named_outputs(tiny_run.output / "manifest.json")
    made = {(event.stage, event.of): event.fingerprint for event in events}
    assert {("codebook", name) for name in learnt.record.objects} <= made.keys()
    for name, object_id in learnt.record.objects.items():
        stage = tiny_run.folder / "work" / "codebook" / made["codebook", name]
        own, copied = load_codebook(stage), learnt.load_codebook(object_id)
        np.testing.assert_array_equal(own.features, copied.features)
    assert learnt.load_encoder() is not None
    settings = SyntheticSettings(width=320, height=240, objects=(5, 5), clutter=(1, 3))
    frame = SyntheticScenes(settings).load("000000_000000")
    found = Detector.load(exported).detect(
        frame.rgb, frame.depth, frame.camera_matrix, max_instances=1, min_score=0.0
    )
    assert {answer.object for answer in found} <= set(learnt.record.objects) and found


def test_objects_that_the_run_did_not_look_for_are_classes_only(
    tiny_run: TinyRun, run: Run, tmp_path: Path
) -> None:
    """As on LINEMOD's board: the classifier tells fifteen objects apart, eight are targets."""
    known = run.dataset.target_ids
    asked = replace(run, dataset=replace(run.dataset, target_ids=known[1:3]))
    (tmp_path / "learnt").mkdir()
    learnt_of_run(asked, tiny_run.output / "manifest.json", tmp_path / "learnt")
    learnt = LearntFolder(tmp_path / "learnt")
    assert sorted(learnt.record.objects.values()) == list(known[1:3])
    assert learnt.classes == known
    detector = Detector.load(tmp_path / "learnt")
    assert len(detector.objects) == 2
    frame = run.dataset.frames.load(run.keys[0])
    detector.detect(frame.rgb, frame.depth, frame.camera_matrix, max_instances=1)


def test_a_run_whose_outputs_are_elsewhere_is_named(tiny_run, tmp_path, fails) -> None:
    words = ["export", str(tiny_run.output), str(tmp_path / "learnt"), f"work={tmp_path}"]
    error = fails("objects", *words)
    assert f"{tmp_path} has no classifier that {tiny_run.output}" in error
    assert not (tmp_path / "learnt").exists()


def test_the_index_that_objects_share_is_made(tiny_run: TinyRun, run: Run, tmp_path: Path) -> None:
    patches = run.settings.patches
    patches = replace(patches, local=replace(patches.local, size_mm=45.0))
    settings = replace(run.settings, codebook=JointListsSettings(), patches=patches)
    (tmp_path / "learnt").mkdir()
    manifest = tiny_run.output / "manifest.json"
    learnt_of_run(replace(run, settings=settings), manifest, tmp_path / "learnt")
    learnt = LearntFolder(tmp_path / "learnt")
    prepared = learnt.search_folder(run.dataset.target_ids)
    assert (prepared / "lists.npz").is_file()
    check_files(tmp_path / "learnt", learnt.record)
