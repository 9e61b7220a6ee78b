"""Objects whose patches are looked up in one index: learnt, found, added, removed."""

import shutil

import numpy as np
import pytest

from hlp import Detector
from hlp.method.learn.learnt_folder import SEARCHES
from made_once import made_once
from tiny_method import MODELS, tiny_method, train_nothing, write_meshes

JOINT = ("codebook=joint_lists", "patches.local.size_mm=45", "rendering.viewpoints=30")


@pytest.fixture(scope="module")
def joint(tmp_path_factory, learnt):
    """A folder of the demo's bear and can that share an index; the classifier is a copied one."""

    def make(folder):
        meshes = write_meshes(folder, "bear", "can")
        with pytest.MonkeyPatch.context() as patch:
            train_nothing(patch, learnt)
            Detector.learn(meshes, folder / "objects", settings=tiny_method(*JOINT))

    return made_once(tmp_path_factory, "joint", make) / "objects"


def no_training(monkeypatch):
    monkeypatch.setattr("hlp.codebook.inverted_lists._train", lambda *_: 1 / 0)


def searches(folder):
    return sorted(path.name for path in (folder / SEARCHES).iterdir())


def test_the_bear_is_found_by_any_number_of_threads_and_whoever_else_is_looked_for(
    joint, frame, image, monkeypatch
):
    no_training(monkeypatch)
    one, two = (Detector.load(joint, threads=threads) for threads in (1, 2))
    alone = one.detect(*image, objects=["bear"], max_instances=1)
    both = two.detect(*image, max_instances=1)
    assert len(alone) == 1
    (bear,) = (item for item in both if item.object == "bear")
    np.testing.assert_array_equal(bear.pose_cam_obj, alone[0].pose_cam_obj)
    true = next(t for t in frame.targets if t.object_id == MODELS["bear"].object_id)
    apart = bear.pose_cam_obj[:3, 3] - true.pose_cam_obj[:3, 3]
    assert np.linalg.norm(apart) < 0.1 * MODELS["bear"].diameter


def test_removing_an_object_leaves_an_index_of_the_others(joint, image, tmp_path, monkeypatch):
    folder = shutil.copytree(joint, tmp_path / "learnt")
    (before,) = searches(folder)
    detector = Detector.load(folder)
    detector.remove("can")
    (after,) = searches(folder)
    assert after != before
    no_training(monkeypatch)
    for item in (detector, Detector.load(folder)):
        found = item.detect(*image, max_instances=1)
        assert [one.object for one in found] == ["bear"]


@pytest.mark.slow
def test_adding_an_object_makes_an_index_of_all(joint, image, tmp_path, monkeypatch):
    folder = shutil.copytree(joint, tmp_path / "learnt")
    before = searches(folder)
    Detector.load(folder).add(write_meshes(tmp_path, "duck"))
    assert len(searches(folder)) == 1 and searches(folder) != before
    no_training(monkeypatch)
    Detector.load(folder).detect(*image)
