"""Folders of learnt objects that the detector refuses: damaged, foreign, not learnt."""

import json
import re
import shutil
from pathlib import Path

import pytest

from hlp import Detector
from hlp.checksums import sealed
from hlp.data.synthetic.objects import demo_objects
from hlp.errors import DataError, InputError, MissingFileError
from hlp.method.learn.learnt_folder import RECORD
from hlp.records import Frame
from tiny_method import tiny_method, write_mesh

MODELS = {model.name: model for model in demo_objects().values()}


def test_a_folder_holds_nothing_that_runs_code(learnt: Path) -> None:
    kinds = {path.suffix for path in learnt.rglob("*") if path.is_file()}
    assert kinds <= {".json", ".npz", ".safetensors", ".onnx", ".csv"}, kinds


def test_wrong_folders_are_refused_by_name(learnt: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no learnt objects"):
        Detector.load(tmp_path)
    mesh = write_mesh(tmp_path, MODELS["bear"])
    with pytest.raises(InputError, match="holds learnt objects already"):
        Detector.learn({"bear": mesh}, learnt, settings=tiny_method())
    with pytest.raises(InputError, match=r"object name '\.\./bear'"):
        Detector.learn({"../bear": mesh}, tmp_path / "new", settings=tiny_method())
    with pytest.raises(InputError, match="'bear' and 'Bear' differ only in case"):
        Detector.learn({"bear": mesh, "Bear": mesh}, tmp_path / "new", settings=tiny_method())
    with pytest.raises(InputError, match="'bear' and 'Bear' differ only in case"):
        Detector.load(learnt).add({"Bear": mesh})
    folder = shutil.copytree(learnt, tmp_path / "damaged")
    record = json.loads((folder / RECORD).read_text())
    del record["checksum"]
    (folder / RECORD).write_text(json.dumps(sealed({**record, "format": 99})))
    with pytest.raises(DataError, match=r"learnt.json: format is 99"):
        Detector.load(folder)
    (folder / RECORD).write_text("{")
    with pytest.raises(DataError, match="is no JSON"):
        Detector.load(folder)


@pytest.mark.parametrize(
    "file",
    [
        "objects/bear/codebook.npz",
        "objects/bear/model.npz",
        "objects/bear/object.json",
        "classifier/classifier.int8.onnx",
        "encoder/pca.npz",
    ],
)
def test_damaged_and_missing_files_are_named(
    learnt: Path, frame: Frame, tmp_path: Path, file: str
) -> None:
    given = frame.rgb, frame.depth, frame.camera_matrix
    path = shutil.copytree(learnt, tmp_path / "learnt") / file
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError, match=re.escape(path.name)):
        Detector.load(tmp_path / "learnt").detect(*given)
    path.unlink()
    with pytest.raises(MissingFileError, match=re.escape(path.name)):
        Detector.load(tmp_path / "learnt").detect(*given)


def flip_a_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


FILES = (
    "learnt.json",
    "classifier/classifier.int8.onnx",
    "encoder/pca.npz",
    "objects/bear/codebook.npz",
    "objects/bear/model.npz",
    "objects/bear/object.json",
    "objects/bear/score.json",
)


@pytest.mark.parametrize("file", FILES)
def test_a_flipped_byte_is_found_before_anything_is_detected(
    learnt: Path, frame: Frame, tmp_path: Path, file: str
) -> None:
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    flip_a_byte(folder / file)
    with pytest.raises(DataError, match=rf"{re.escape(file)} is .*: learn the objects again"):
        Detector.load(folder).detect(frame.rgb, frame.depth, frame.camera_matrix)


@pytest.mark.parametrize("file", ["learnt.json", "classifier/weights.safetensors"])
def test_learning_into_a_damaged_folder_makes_it_again(
    learnt: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    """The damaged one is kept; nothing is added to it."""
    from hlp.method.learn import learning

    folder = shutil.copytree(learnt, tmp_path / "learnt")
    flip_a_byte(folder / file)
    with pytest.raises(DataError, match=re.escape(file)):
        Detector.load(folder).add({"duck": write_mesh(tmp_path, MODELS["duck"])})
    meshes = {name: write_mesh(tmp_path, MODELS[name]) for name in ("bear", "can")}
    monkeypatch.setattr(learning, "train_classifier", lambda *_: 1 / 0)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            Detector.learn(meshes, folder, settings=tiny_method())
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {
        "learnt.damaged",
        "learnt.partial",
    }


@pytest.mark.parametrize("name", ["../../secret", "/etc", ".", "a/b"])
def test_a_folder_names_no_file_outside_of_it(learnt: Path, tmp_path: Path, name: str) -> None:
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    record = json.loads((folder / RECORD).read_text())
    del record["checksum"]
    for changed in ({"objects": {name: 1}}, {"files": {f"classifier/../../{name}": "0"}}):
        (folder / RECORD).write_text(json.dumps(sealed(record | changed)))
        with pytest.raises(DataError, match=r"cannot name an object|names a file outside"):
            Detector.load(folder).warm_up()


def test_a_plug_in_that_is_not_installed_is_no_damage(learnt: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(learnt, tmp_path / "learnt")
    record = json.loads((folder / RECORD).read_text())
    record["settings"]["encoder"]["name"] = "cells"
    del record["checksum"]
    (folder / RECORD).write_text(json.dumps(sealed(record)))
    with pytest.raises(DataError, match=r"learnt.json: .*encoder.name is 'cells': choose one of"):
        Detector.load(folder)
