"""What is wrong with frames on disk is found before anything is computed; sound ones pass."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from bop_folder import write_models, write_scene, write_targets
from hlp.data.bop import BopFrames
from hlp.data.bop_models import load_object_models
from hlp.data.dataset import find_bad_frames
from hlp.objects.object_model import ObjectSettings

SOUND, BROKEN = "000006_000000", "000006_000012"
ROWS = [(6, 0, 1, 1), (6, 0, 6, 2), (6, 12, 1, 1)]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Any:
    root = tmp_path_factory.mktemp("models")
    write_models(root / "models", (1, 6))
    objects = {"box": ObjectSettings(1), "other": ObjectSettings(6)}
    return load_object_models(root, objects, 500, 8)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write_scene(tmp_path / "test")
    write_targets(tmp_path / "targets.json", ROWS)
    return tmp_path


def bad_frames(root: Path, models: Any, targets: str | None = "targets.json") -> dict[str, str]:
    frames = BopFrames(root, "test", targets, models)
    dataset: Any = SimpleNamespace(frames=frames, models=models)
    return find_bad_frames(dataset, frames.keys)


def scene_file(root: Path, name: str) -> Path:
    return root / "test" / "000006" / name


def edited(name: str, change: Callable[[Any], Any]) -> Callable[[Path], None]:
    """Change what a scene's file states of frame 12, or of its first instance."""

    def edit(root: Path) -> None:
        path = scene_file(root, name)
        content = json.loads(path.read_text())
        content["12"] = change(content["12"])
        if content["12"] is None:
            del content["12"]
        path.write_text(json.dumps(content))

    return edit


def with_pose(**values: Any) -> Callable[[Path], None]:
    return edited("scene_gt.json", lambda entries: [{**entries[0], **values}])


def without(key: str) -> Callable[[Path], None]:
    return edited("scene_gt.json", lambda e: [{k: v for k, v in e[0].items() if k != key}])


def truncated(name: str) -> Callable[[Path], None]:
    return lambda root: scene_file(root, name).write_bytes(scene_file(root, name).read_bytes()[:20])


def image(name: str, pixels: np.ndarray) -> Callable[[Path], None]:
    return lambda root: cv2.imwrite(str(scene_file(root, name)), pixels) and None


def gone(name: str) -> Callable[[Path], None]:
    return lambda root: scene_file(root, name).unlink()


TURN = np.eye(3).ravel()
CASES = {
    "truncated colour": (truncated("rgb/000012.png"), "000012.png is truncated"),
    "truncated depth": (truncated("depth/000012.png"), "000012.png is truncated"),
    "no colour": (gone("rgb/000012.png"), "no image"),
    "no depth": (gone("depth/000012.png"), "no image"),
    "another size": (image("rgb/000012.png", np.zeros((30, 40, 3), np.uint8)), "40x30 but its"),
    "8 bits of depth": (image("depth/000012.png", np.ones((60, 80), np.uint8)), "16-bit"),
    "depth of three channels": (
        image("depth/000012.png", np.ones((60, 80, 3), np.uint16)),
        "one channel",
    ),
    "no camera": (edited("scene_camera.json", lambda _: None), "has no cam_K for frame 12"),
    "null camera": (edited("scene_camera.json", lambda _: {"cam_K": None}), "cam_K is null"),
    "a list as camera": (edited("scene_camera.json", lambda _: [1]), "must be an object"),
    "eight numbers": (
        edited("scene_camera.json", lambda e: {"cam_K": e["cam_K"][:8]}),
        "must have 9",
    ),
    "words": (edited("scene_camera.json", lambda e: {"cam_K": ["f"] * 9}), "cam_K.0 is 'f'"),
    "no focal length": (
        edited("scene_camera.json", lambda e: {"cam_K": [0.0, *e["cam_K"][1:]]}),
        "focal lengths must be finite and positive",
    ),
    "intrinsics of a larger image": (
        edited("scene_camera.json", lambda e: {"cam_K": [2 * v for v in e["cam_K"][:8]] + [1]}),
        "principal point (80, 60) lies outside the image of 80x60",
    ),
    "focal lengths in millimetres": (
        edited("scene_camera.json", lambda e: {"cam_K": [1.9, 0, 40, 0, 1.9, 30, 0, 0, 1]}),
        "fx is 1.9 px",
    ),
    "columns for rows": (
        edited(
            "scene_camera.json",
            lambda e: {"cam_K": np.reshape(e["cam_K"], (3, 3)).T.ravel().tolist()},
        ),
        "fx 0 cx 0 fy cy 0 0 1",
    ),
    "depth_scale 0": (
        edited("scene_camera.json", lambda e: {**e, "depth_scale": 0}),
        "depth_scale",
    ),
    "depth_scale NaN": (
        edited("scene_camera.json", lambda e: {**e, "depth_scale": float("nan")}),
        "depth_scale is nan",
    ),
    "depth_scale below 0": (
        edited("scene_camera.json", lambda e: {**e, "depth_scale": -1.0}),
        "depth_scale is -1.0",
    ),
    "null depth_scale": (
        edited("scene_camera.json", lambda e: {**e, "depth_scale": None}),
        "depth_scale is null: it must be a number",
    ),
    "no pose": (edited("scene_gt.json", lambda _: []), "1 of object 1 should be found, 0 have"),
    "an object for a list": (edited("scene_gt.json", lambda e: e[0]), "must be a list"),
    "a number for an object": (edited("scene_gt.json", lambda _: [7]), "must be an object"),
    "null for a list": (edited("scene_gt.json", lambda _: "?"), "must be a list"),
    "no obj_id": (without("obj_id"), "0.obj_id is missing"),
    "no cam_t_m2c": (without("cam_t_m2c"), "0.cam_t_m2c is missing"),
    "no cam_R_m2c": (without("cam_R_m2c"), "0.cam_R_m2c is missing"),
    "an id that is no whole number": (with_pose(obj_id=1.5), "obj_id is 1.5: it must be a whole"),
    "an id in words": (with_pose(obj_id="1"), "obj_id is '1': it must be a whole number"),
    "an id below 0": (with_pose(obj_id=-1), "obj_id is -1"),
    "a true id": (with_pose(obj_id=True), "obj_id is True"),
    "two numbers": (with_pose(cam_t_m2c=[0.0, 700.0]), "cam_t_m2c has 2 numbers, it must have 3"),
    "metres": (with_pose(cam_t_m2c=[0.0, 0.0, 0.7]), "are these metres?"),
    "behind the camera": (with_pose(cam_t_m2c=[0.0, 0.0, -700.0]), "behind the camera"),
    "micrometres": (with_pose(cam_t_m2c=[0.0, 0.0, 7e5]), "places the object 700 m away"),
    "a reflection": (with_pose(cam_R_m2c=(TURN * -1).tolist()), "no rotation but a reflection"),
    "a scaled rotation": (with_pose(cam_R_m2c=(TURN * 1.01).tolist()), "is no rotation"),
    "a rotation of zeros": (with_pose(cam_R_m2c=[0.0] * 9), "is no rotation"),
    "infinity": (with_pose(cam_R_m2c=[float("inf")] * 9), "is inf: it must be a finite number"),
    "a visible fraction of 2": (
        edited("scene_gt_info.json", lambda _: [{"visib_fract": 2.0}]),
        "visib_fract is 2.0: it must be less than or equal to 1",
    ),
    "visible fractions of more instances": (
        edited("scene_gt_info.json", lambda e: [*e, *e]),
        "scene_gt_info.json has 2 instances, but there are 1 poses",
    ),
    "a null visible fraction": (
        edited("scene_gt_info.json", lambda _: [{"visib_fract": None}]),
        "visib_fract is null",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bad_frame_is_found_alone(root: Path, models: Any, case: str) -> None:
    spoil, words = CASES[case]
    assert bad_frames(root, models) == {}
    spoil(root)
    found = bad_frames(root, models)
    assert [*found] == [BROKEN]
    assert words in found[BROKEN]


@pytest.mark.parametrize("case", ["no obj_id", "no cam_t_m2c", "null for a list", "no camera"])
def test_without_a_list_of_targets_a_broken_frame_is_still_one_of_the_run(
    root: Path, models: Any, case: str
) -> None:
    CASES[case][0](root)
    assert [*bad_frames(root, models, None)] == [BROKEN]


@pytest.mark.parametrize("case", ["no depth", "no pose", "no obj_id", "no camera"])
def test_the_targets_of_a_bad_frame_are_known_and_its_identity_differs(
    root: Path, models: Any, case: str
) -> None:
    before = BopFrames(root, "test", "targets.json", models)
    stated, identity = before.stated_targets(BROKEN), before.identity()
    assert [(each.object_id, each.visible_fraction) for each in stated] == [(1, 0.05)]
    CASES[case][0](root)
    after = BopFrames(root, "test", "targets.json", models)
    assert [each.object_id for each in after.stated_targets(BROKEN)] == [1]
    assert after.identity() != identity


def test_the_targets_stated_of_a_sound_frame_are_those_that_it_has(root: Path, models: Any) -> None:
    frames = BopFrames(root, "test", "targets.json", models)
    loaded = frames.load(SOUND).targets
    wanted = [(each.object_id, each.visible_fraction) for each in loaded]
    stated = [(each.object_id, each.visible_fraction) for each in frames.stated_targets(SOUND)]
    assert stated == wanted


def test_a_wrong_unit_of_depth_is_said_of_all_frames(root: Path, models: Any) -> None:
    path = scene_file(root, "scene_camera.json")
    content = json.loads(path.read_text())
    for each in content.values():
        each["depth_scale"] = 1000.0
    path.write_text(json.dumps(content))
    found = bad_frames(root, models)
    assert [*found] == [SOUND, BROKEN]
    assert all("are these metres" in each for each in found.values())
