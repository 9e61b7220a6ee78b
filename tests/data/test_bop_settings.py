"""`data=bop data.root=PATH`: everything else is found in the folder."""

import json
import shutil
from pathlib import Path

import pytest

from bop_folder import write_models, write_scene, write_targets
from hlp.data.bop import BopSettings
from hlp.errors import HlpError

pytestmark = pytest.mark.usefixtures("no_near_symmetries")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write_scene(tmp_path / "test")
    write_models(tmp_path / "models", [1, 2, 6])
    return tmp_path


def _names(root: Path, **settings: object) -> dict[int, str]:
    models = BopSettings(root=str(root), **settings).build().models
    return {object_id: model.name for object_id, model in models.items()}


def test_a_folder_is_enough(root):
    dataset = BopSettings(root=str(root)).build()
    assert {i: model.name for i, model in dataset.models.items()} == {
        1: "obj_000001",
        6: "obj_000006",
    }
    assert dataset.target_ids == (1, 6)
    assert dataset.frames.keys == ("000006_000000", "000006_000012")
    assert len(dataset.frames.load("000006_000000").targets) == 3


def test_names_come_from_the_set(root):
    (root / "models" / "names.json").write_text(json.dumps({"1": "ape", "2": "vise"}))
    assert _names(root) == {1: "ape", 6: "obj_000006"}
    (root / "models" / "names.json").write_text(json.dumps({"1": "ape", "6": "ape"}))
    with pytest.raises(HlpError, match="several objects 'ape'"):
        _names(root)


def test_some_objects_are_named(root):
    dataset = BopSettings(root=str(root), only=("obj_000006",)).build()
    assert tuple(dataset.models) == dataset.target_ids == (6,)
    with pytest.raises(HlpError, match="must be some of"):
        BopSettings(root=str(root), only=()).build()


@pytest.mark.parametrize("name", ["../../x", "/x", "a/b", "a\\b", ".x", ""])
def test_a_name_from_a_stranger_is_no_path(root, name):
    """Pictures and learnt objects get it as the name of a file."""
    (root / "models" / "names.json").write_text(json.dumps({"1": name}))
    with pytest.raises(HlpError, match=r"names\.json"):
        _names(root)


def test_the_list_of_targets_says_what_is_learnt(root):
    write_targets(root / "test_targets_bop24.json", [(6, 12)])
    assert _names(root) == {1: "obj_000001"}
    write_targets(root / "test_targets_bop19.json", [(6, 0, 6, 2)])
    dataset = BopSettings(root=str(root)).build()
    assert dataset.target_ids == (6,)
    fractions = [target.visible_fraction for target in dataset.frames.load("000006_000000").targets]
    assert fractions == [0.7, 0.2]
    assert _names(root, targets=None) == {1: "obj_000001", 6: "obj_000006"}


@pytest.mark.parametrize("listed", [True, False])
def test_targets_can_be_restricted_to_visible_ones(root, listed):
    if listed:
        write_targets(root / "test_targets_bop19.json", [(6, 0, 1, 1), (6, 0, 6, 2), (6, 12, 1, 1)])
    frames = BopSettings(root=str(root), min_visible=0.3).build().frames
    assert frames.keys == ("000006_000000",)
    targets = frames.load("000006_000000").targets
    assert [(target.object_id, target.visible_fraction) for target in targets] == [
        (1, 0.9),
        (6, 0.7),
    ]
    (root / "test" / "000006" / "scene_gt_info.json").unlink()  # then nothing is known: all count
    assert len(BopSettings(root=str(root), min_visible=0.3).build().frames.keys) == 2


def test_the_first_test_folder_with_poses_is_taken(root):
    shutil.move(root / "test", root / "val")
    write_scene(root / "test_kinect")
    write_scene(root / "test_primesense", scene=2)
    (root / "test_kinect" / "000006" / "scene_gt.json").unlink()
    assert BopSettings(root=str(root)).build().frames.keys[0].startswith("000002")
    shutil.rmtree(root / "test_primesense")
    assert BopSettings(root=str(root)).build().frames.keys[0].startswith("000006")
    write_targets(root / "test_targets_bop19.json", [(6, 0, 1, 1)])  # not that of val
    assert len(BopSettings(root=str(root)).build().frames.keys) == 2
    assert len(BopSettings(root=str(root), split="test_kinect").build().frames.keys) == 1


def test_bops_errors_are_measured_on_models_eval(root):
    write_models(root / "models_eval", [1], side_mm=60.0)
    dataset = BopSettings(root=str(root)).build()
    assert set(dataset.evaluation_meshes) == {1}
    assert dataset.evaluation_meshes[1].vertices.max() == pytest.approx(0.04)
    assert dataset.models[1].mesh.vertices.max() == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("removed", "message"),
    [
        ("models", r"no mesh of object 1 \(obj_000001\), tried .*models"),
        ("test", r"no folder test, test_\* or val: set data\.split=NAME"),
        ("test/000006", r"no scene in .*test"),
        ("test/000006/scene_gt.json", r"scene_gt\.json .*set data\.split"),
        ("test/000006/scene_camera.json", r"no file .*scene_camera\.json"),
    ],
)
def test_what_is_missing_is_named(root, removed, message):
    path = root / removed
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    with pytest.raises(HlpError, match=message):
        BopSettings(root=str(root)).build()


def test_a_set_without_targets_is_an_error(root):
    write_targets(root / "test_targets_bop19.json", [])
    with pytest.raises(HlpError, match=r"test_targets_bop19\.json lists no target of any object"):
        BopSettings(root=str(root)).build()


def test_a_folder_that_is_absent_is_named_with_its_key(root):
    with pytest.raises(HlpError, match=r"data\.root is not a folder"):
        BopSettings(root=str(root / "none")).build()
    with pytest.raises(HlpError, match=r"has no folder train: set data\.split=NAME"):
        BopSettings(root=str(root), split="train").build()


@pytest.mark.parametrize(
    ("name", "frames", "targets", "objects"),
    [
        ("lm", 202, 1309, 8),
        ("cup", 29, 87, 1),
        ("mustard", 19, 19, 1),
        ("ycbv", 15, 55, 10),
        ("parts", 5, 30, 3),
        ("boxes", 14, 226, 2),
    ],
)
def test_the_development_sets_are_read_by_their_folders(
    shared_data, name, frames, targets, objects
):
    dataset = BopSettings(root=str(shared_data / name)).build()
    assert len(dataset.frames.keys) == frames
    assert sum(sum(found.values()) for found in dataset.frames.targets.values()) == targets
    assert len(dataset.models) == objects
    assert dataset.frames.load(dataset.frames.keys[0]).targets
