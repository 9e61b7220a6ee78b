"""Folders of learnt objects that the detector refuses: damaged, foreign, not learnt."""

import json
import re
import shutil

import pytest

from damage import damage
from hlp import Detector
from hlp.errors import DataError, InputError, MissingFileError
from hlp.fingerprints import sealed
from hlp.method.learn.learnt_folder import RECORD
from tiny_method import tiny_method, write_meshes


def rewrite(folder, **values):
    """Give the record other values, with a right checksum."""
    record = json.loads((folder / RECORD).read_text()) | values
    record.pop("checksum")
    (folder / RECORD).write_text(json.dumps(sealed(record)))


def test_a_folder_holds_nothing_that_runs_code(learnt):
    kinds = {path.suffix for path in learnt.rglob("*") if path.is_file()}
    assert kinds <= {".json", ".npz", ".safetensors", ".onnx", ".csv"}, kinds


def test_wrong_folders_and_names_are_refused(learnt, folder, tmp_path):
    with pytest.raises(MissingFileError, match="no learnt objects"):
        Detector.load(tmp_path)
    mesh, new = write_meshes(tmp_path, "bear")["bear"], tmp_path / "new"
    for meshes, target, words in (
        ({"bear": mesh}, learnt, "holds learnt objects already"),
        ({"../bear": mesh}, new, r"object name '\.\./bear'"),
        ({"bear": mesh, "Bear": mesh}, new, "'bear' and 'Bear' differ only in case"),
    ):
        with pytest.raises(InputError, match=words):
            Detector.learn(meshes, target, settings=tiny_method())
    with pytest.raises(InputError, match="'bear' and 'Bear' differ only in case"):
        Detector.load(learnt).add({"Bear": mesh})
    rewrite(folder, format=99)
    with pytest.raises(DataError, match=r"learnt.json: format is 99"):
        Detector.load(folder)
    (folder / RECORD).write_text("{")
    with pytest.raises(DataError, match="is not JSON"):
        Detector.load(folder)


@pytest.mark.parametrize("how", ["flipped", "cut", "gone"])
def test_every_damaged_and_missing_file_is_named_before_anything_is_detected(learnt, folder, how):
    files = [path.relative_to(learnt) for path in learnt.rglob("*") if path.is_file()]
    assert len(files) > 10
    for name in files:
        (folder / name).unlink() if how == "gone" else damage([folder / name], how)
        with pytest.raises(MissingFileError if how == "gone" else DataError) as caught:
            Detector.load(folder).warm_up()
        assert name.name in str(caught.value), name
        assert how == "gone" or "learn the objects again" in str(caught.value)
        shutil.copyfile(learnt / name, folder / name)
    Detector.load(folder).warm_up()


@pytest.mark.parametrize("file", ["learnt.json", "classifier/weights.safetensors"])
def test_learning_into_a_damaged_folder_makes_it_again(folder, tmp_path, monkeypatch, file):
    """The damaged one is kept; nothing is added to it."""
    from hlp.method.learn import learning

    damage([folder / file], "flipped")
    with pytest.raises(DataError, match=re.escape(file)):
        Detector.load(folder).add(write_meshes(tmp_path, "duck"))
    meshes = write_meshes(tmp_path, "bear", "can")
    monkeypatch.setattr(learning, "train_classifier", lambda *_: 1 / 0)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            Detector.learn(meshes, folder, settings=tiny_method())
    left = {path.name for path in tmp_path.iterdir() if path.is_dir()}
    assert left == {"learnt.damaged", "learnt.partial"}


@pytest.mark.parametrize("name", ["../../secret", "/etc", ".", "a/b"])
def test_a_folder_names_no_file_outside_of_it(folder, name):
    record = json.loads((folder / RECORD).read_text())
    for changed in ({"objects": {name: 1}}, {"files": {f"classifier/../../{name}": "0"}}):
        rewrite(folder, **(record | changed))
        with pytest.raises(DataError, match=r"cannot name an object|names a file outside"):
            Detector.load(folder).warm_up()


def test_a_plug_in_that_is_not_installed_is_no_damage(folder):
    settings = json.loads((folder / RECORD).read_text())["settings"]
    settings["encoder"]["name"] = "cells"
    rewrite(folder, settings=settings)
    with pytest.raises(DataError, match=r"learnt.json: .*encoder.name is 'cells': choose one of"):
        Detector.load(folder)
