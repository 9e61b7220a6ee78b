"""Learning into a folder: adding, removing, what an interrupted call leaves, wrong calls."""

import json
import shutil

import numpy as np
import pytest

from hlp import Detector
from hlp.errors import ConfigError, InputError
from hlp.fingerprints import folder_checksums
from hlp.method.learn import learning
from hlp.method.learn.learnt_folder import RECORD
from hlp.method.learn.model_files import read_model
from tiny_method import tiny_method, train_nothing, write_meshes


@pytest.mark.slow
def test_objects_are_added_and_removed(folder, image, tmp_path):
    detector = Detector.load(folder)
    before = read_model(folder / "objects" / "bear")
    detector.add(write_meshes(tmp_path, "duck"))
    assert detector.objects == ("bear", "can", "duck")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["duck.ply", "learnt"]
    np.testing.assert_array_equal(
        read_model(folder / "objects" / "bear").mesh.vertices, before.mesh.vertices
    )
    with pytest.raises(InputError, match="knows an object 'duck' already"):
        detector.add(write_meshes(tmp_path, "duck"))
    detector.remove("can")
    assert detector.objects == ("bear", "duck") == Detector.load(folder).objects
    assert not (folder / "objects" / "can").exists()
    found = detector.detect(*image)
    assert {each.object for each in found} <= {"bear", "duck"}
    # A class that nobody asks for any more keeps its place, and a new object gets a new one.
    assert json.loads((folder / RECORD).read_text())["classes"] == [1, 2, 3]
    detector.add(write_meshes(tmp_path, "lamp"))
    assert json.loads((folder / RECORD).read_text())["classes"] == [1, 3, 4]
    detector.remove("duck")
    detector.remove("lamp")
    with pytest.raises(InputError, match="'bear' is the last object"):
        detector.remove("bear")
    with pytest.raises(InputError, match="no object 'cat'; it knows bear"):
        detector.remove("cat")


@pytest.mark.slow
@pytest.mark.thorough
def test_an_interrupted_call_goes_on_where_it_stopped(learnt, tmp_path, monkeypatch):
    meshes = write_meshes(tmp_path, "bear", "can")
    whole = learning.build_codebook
    monkeypatch.setattr(learning, "build_codebook", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        Detector.learn(meshes, tmp_path / "learnt", settings=tiny_method())
    assert not (tmp_path / "learnt").exists()
    monkeypatch.setattr(learning, "build_codebook", whole)
    monkeypatch.setattr(learning, "train_classifier", lambda *_: 1 / 0)  # done already
    Detector.learn(meshes, tmp_path / "learnt", settings=tiny_method())
    one, two = (folder_checksums(folder) for folder in (learnt, tmp_path / "learnt"))
    assert one.keys() == two.keys()
    assert one["objects/bear/codebook.npz"] == two["objects/bear/codebook.npz"]


def test_an_interrupted_call_with_other_backgrounds_starts_anew(frame, tmp_path, monkeypatch):
    meshes = write_meshes(tmp_path, "bear")
    trained = []
    monkeypatch.setattr(learning, "train_classifier", lambda *given: trained.append(given[2]))
    monkeypatch.setattr(learning, "train_encoder", lambda *_: 1 / 0)
    for frames in ((), (), (frame,)):
        with pytest.raises(ZeroDivisionError):
            Detector.learn(
                meshes, tmp_path / "learnt", settings=tiny_method(), background_frames=frames
            )
    assert [each.frames for each in trained] == [(), (frame,)]


def test_an_encoder_without_the_frames_it_needs_fails_before_anything_is_trained(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(learning, "train_classifier", lambda *_: 1 / 0)
    meshes = write_meshes(tmp_path, "bear")
    with pytest.raises(ConfigError, match="encoder=cae trains on RGB-D frames"):
        Detector.learn(meshes, tmp_path / "learnt", settings=tiny_method("encoder=cae"))
    assert not (tmp_path / "learnt.partial").exists()


def test_objects_are_added_by_way_of_any_path_beside_any_folder(
    learnt, folder, tmp_path, monkeypatch
):
    """A link stays one, `.` has no name, and a copy that the user made is not touched."""
    train_nothing(monkeypatch, learnt)
    kept = shutil.copytree(learnt, tmp_path / "learnt.old")
    (tmp_path / "link").symlink_to(folder)
    Detector.load(tmp_path / "link").add(write_meshes(tmp_path, "duck"))
    assert (tmp_path / "link").is_symlink() and not folder.is_symlink()
    assert Detector.load(folder).objects == ("bear", "can", "duck")
    monkeypatch.chdir(folder)
    detector = Detector.load(".")
    detector.remove("can")
    assert detector.objects == ("bear", "duck") == Detector.load(folder).objects
    assert Detector.load(kept).objects == ("bear", "can")
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"learnt", "learnt.old", "link", "duck.ply"}


def test_two_processes_do_not_learn_into_one_folder(tmp_path):
    meshes = write_meshes(tmp_path, "bear")
    fcntl = pytest.importorskip("fcntl")
    with (tmp_path / ".learnt.lock").open("w") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another process is learning into learnt"):
            Detector.learn(meshes, tmp_path / "learnt", settings=tiny_method())
    (tmp_path / "own.partial").mkdir()
    (tmp_path / "own.partial" / "thesis.txt").write_text("two years of work")
    with pytest.raises(InputError, match=r"own\.partial is in the way"):
        Detector.learn(meshes, tmp_path / "own", settings=tiny_method())
    assert (tmp_path / "own.partial" / "thesis.txt").exists()
