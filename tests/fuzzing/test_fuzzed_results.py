"""Whatever stands in the files that HLP writes: what was written, or an error naming the file."""

import json

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from spoiled_files import is_clean, spoiled

from hlp.errors import DataError
from hlp.fingerprints import sealed
from hlp.geometry import rigid
from hlp.method.learn.learnt_folder import LearntRecord, read_record, write_record
from hlp.method.learn.model_files import read_history
from hlp.method.settings import MethodSettings
from hlp.records import PoseEstimate, TargetScore
from hlp.refinement.score_model import PRIOR, load_score_model, save_score_model
from hlp.reporting.sweeps import read_sweeps
from hlp.results.poses_file import read_poses, read_scores, write_poses, write_scores
from hlp.results.recalls import read_summary
from hlp.stages.manifest import read_manifest
from hlp.stages.store import StageStore
from written_results import summary

NAME = "0123456789abcdef"
SUMMARY = summary()
MANIFEST = {
    "config": {"name": "demo", "seed": 0},
    "data": {"keys": ["000000_000000"], "frames": "ab"},
    "stages": [{"stage": "views", "fingerprint": NAME}],
}
SWEEP = {"overrides": ["seed=0,1"], "swept": ["seed"], "defaults": {"seed": 0}, "status": "done"}


def scored(number):
    return TargetScore(1, number, 2, True, 0.9, 0.01, 0.1, 0.02, 0.8, True, True, True)


KINDS = (
    *("poses.csv", "scores.csv", "history.csv", "summary.json", "manifest.json", "score.json"),
    "learnt.json",
)


def write_text_files(folder):
    """A valid file of each kind, and what reads it."""
    estimate = PoseEstimate(1, 2, 3, rigid(np.eye(3), np.array([0.1, 0.2, 0.9])), 0.5, {"a": 1.0})
    write_poses(folder / "poses.csv", [estimate, estimate])
    write_scores(folder / "scores.csv", [scored(0), scored(1)], {2: "cat"})
    (folder / "history.csv").write_text("epoch,loss\n0,1.5\n1,0.75\n")
    (folder / "summary.json").write_text(json.dumps(SUMMARY))
    (folder / "manifest.json").write_text(json.dumps(MANIFEST))
    save_score_model(folder, PRIOR)
    write_record(folder, LearntRecord({"cat": 1}, (1,), MethodSettings(), {"a": "0"}))
    return {
        "poses.csv": lambda: read_poses(folder / "poses.csv"),
        "scores.csv": lambda: read_scores(folder / "scores.csv"),
        "history.csv": lambda: read_history(folder),
        "summary.json": lambda: read_summary(folder / "summary.json"),
        "manifest.json": lambda: read_manifest(folder / "manifest.json"),
        "score.json": lambda: load_score_model(folder),
        "learnt.json": lambda: read_record(folder),
    }


@pytest.mark.parametrize("name", KINDS)
@given(data=st.data())
def test_files_of_runs_and_learnt_folders(tmp_path, name, data):
    read = write_text_files(tmp_path)[name]
    assert is_clean(read, tmp_path / name)
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data.draw(spoiled(content)))
    is_clean(read, tmp_path / name)


@pytest.mark.parametrize("resealed", [False, True])
@given(data=st.data())
def test_records_of_learnt_objects_and_outputs(tmp_path, resealed, data):
    """With `resealed` the checksum fits, as only somebody who wants it so can have it."""

    def spoil(path):
        record = json.loads(path.read_text())
        del record["checksum"]
        content = data.draw(spoiled(json.dumps(record).encode()))
        try:
            other = json.loads(content)
            path.write_text(json.dumps(sealed(other) if resealed else other))
        except (ValueError, TypeError):
            path.write_bytes(content)

    write_text_files(tmp_path)
    spoil(tmp_path / "learnt.json")
    is_clean(lambda: read_record(tmp_path), tmp_path / "learnt.json")
    store = StageStore(tmp_path / "work")
    if not store.holds("views", NAME):
        store.get_or_make("views", NAME, lambda folder: (folder / "x").touch(), {"settings": {}})
    path = tmp_path / "work" / "views" / NAME / "stage.json"
    sound = path.read_bytes()
    spoil(path)
    is_clean(lambda: StageStore(tmp_path / "work").read_record("views", NAME), path.parent)
    path.write_bytes(sound)


@given(spoiled(json.dumps(SWEEP).encode()))
def test_sweeps(tmp_path, content):
    (tmp_path / "0").mkdir(exist_ok=True)
    (tmp_path / "0" / "summary.json").write_text(json.dumps(SUMMARY))
    (tmp_path / "0" / "manifest.json").write_text(json.dumps(MANIFEST))
    (tmp_path / "sweep.json").write_bytes(content)
    is_clean(lambda: read_sweeps(tmp_path), tmp_path)


@given(spoiled(b"- experiment=demo\n- seed=1\n- output=out\n"))
@example(b"*a")
@example(b"seed")
@example(b"- 1")
def test_overrides_of_a_run(tmp_path, content):
    (tmp_path / "summary.json").write_text(json.dumps(SUMMARY))
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST))
    (tmp_path / ".hydra").mkdir(exist_ok=True)
    (tmp_path / ".hydra" / "overrides.yaml").write_bytes(content)
    is_clean(lambda: read_sweeps(tmp_path), tmp_path)


@pytest.mark.parametrize(
    ("name", "content"),
    [("history.csv", "epoch,loss\n0,x\n"), ("history.csv", "epoch,loss\n0\n")],
)
def test_a_damaged_history_is_named(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(DataError, match=r"history\.csv, line 2"):
        read_history(tmp_path)
