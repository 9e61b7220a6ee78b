"""Scenes in BOP's layout, and lists of targets."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from bad_input import DEEP, Case, check, of_file, written
from bop_folder import write_scene, write_targets
from hlp.data.bop import BopFrames
from hlp.data.bop_scenes import list_scenes, list_targets
from hlp.errors import MissingFileError


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write_scene(tmp_path / "test")
    write_targets(tmp_path / "targets.json", [(6, 12, 1, 1), (6, 0, 1, 1), (6, 0, 6, 1)])
    return tmp_path


def test_targets_are_those_listed_or_all_that_is_annotated(root):
    scenes = list_scenes(root / "test")
    assert list_targets(scenes, root / "targets.json") == {(6, 12): {1: 1}, (6, 0): {1: 1, 6: 1}}
    assert list_targets(scenes, None) == {(6, 0): {1: 1, 6: 2}, (6, 12): {1: 1}}
    assert [target.object_id for target in scenes[6].targets(0)] == [1, 6, 6]


@pytest.mark.parametrize("color", ["gray/tif", "gray/png", "rgb/jpg"])
def test_grey_images_and_other_extensions_are_read(tmp_path, color):
    write_scene(tmp_path / "test", color)
    frames = BopFrames(tmp_path / "test", None)
    frame = frames.load(frames.keys[0])
    assert frame.rgb.shape == (60, 80, 3)
    if color.startswith("gray"):
        assert (frame.rgb == frame.rgb[..., :1]).all()
    assert frames.identity()


def test_scene_folders_may_have_any_number_of_digits(root):
    shutil.move(root / "test" / "000006", root / "test" / "6")
    (root / "test" / "notes").mkdir()
    assert BopFrames(root / "test", None).keys[0] == "000006_000000"


def test_a_scene_that_is_listed_and_absent_is_named(root):
    write_targets(root / "targets.json", [(6, 12, 1, 1), (7, 0, 1, 1)])
    with pytest.raises(MissingFileError, match="no scene 7"):
        BopFrames(root / "test", root / "targets.json").load("000007_000000")


def listed(text: str) -> Any:
    return of_file(lambda path: list_targets({}, path), "targets.json", text)


ROW = {"scene_id": 1, "im_id": 2, "obj_id": 3, "inst_count": 1}
TARGETS: dict[str, Case] = {
    "targets: an object": (listed('{"6": [1, 2]}'), "it must be a list"),
    "targets: one object twice": (listed(json.dumps([ROW, ROW])), "lists object 3"),
    "targets: no scene": (listed('[{"im_id": 1}]'), "0.scene_id is missing"),
}
for _key in ROW:
    _broken = json.dumps([{**ROW, _key: -1}])
    TARGETS[f"targets: {_key} below 0"] = (listed(_broken), f"0.{_key} is -1")


def two_folders(folder: Path) -> object:
    (folder / "6").mkdir()
    (folder / "000006").mkdir()
    return list_scenes(folder)


SCENES: dict[str, Case] = {
    "no split": (lambda folder: list_scenes(folder / "test"), "no folder"),
    "two folders of a scene": (two_folders, "two folders of scene 6"),
    "no scene": (list_scenes, "no scene in"),
}
for _text, _said in (
    ("[]", "must be a mapping"),
    ("null", "must be a mapping"),
    ('{"a": {}}', "the key 'a' is not an id"),
    ('{"-1": {}}', "the key '-1' is not an id"),
    ('{"01": {}}', "the key '01' is not an id"),
    ('{"1.5": {}}', "the key '1.5' is not an id"),
    (DEEP, "nested deeper"),
):

    def _frames(folder: Path, text: str = _text) -> object:
        written(folder / "000001" / "scene_camera.json", text)
        return list_scenes(folder)[1].frame_ids

    SCENES[f"scene_camera: {_text[:9]}"] = (_frames, _said)

TEXTS = {**TARGETS, **SCENES}


@pytest.mark.parametrize("case", TEXTS)
def test_what_is_wrong_with_lists_and_scenes_is_said(tmp_path: Path, case: str) -> None:
    check(TEXTS[case], tmp_path)
