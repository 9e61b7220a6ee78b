"""Frames in BOP's layouts: what is read of sound ones, and how bad ones are found."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bop_folder import K, write_models, write_scene, write_targets
from hlp.data.bop import BopFrames, BopSettings
from hlp.data.bop_models import load_object_models
from hlp.data.dataset import find_bad_frames
from hlp.errors import DataError, MissingFileError
from hlp.geometry import project, transform
from hlp.objects.meshes import load_mesh
from hlp.objects.object_model import ObjectSettings

SOUND, BROKEN = "000006_000000", "000006_000012"
ROWS = [(6, 12, 1, 1), (6, 0, 1, 1), (6, 0, 6, 1)]
TURN = Rotation.from_euler("xyz", [0.3, -0.2, 0.9]).as_matrix()


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Any:
    root = tmp_path_factory.mktemp("models")
    write_models(root / "models", (1, 6))
    return load_object_models(root, {"box": ObjectSettings(1), "other": ObjectSettings(6)}, 500, 8)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write_scene(tmp_path / "test")
    write_targets(tmp_path / "targets.json", ROWS)
    return tmp_path


def frames_of(
    root: Path, object_ids: Any = None, targets: str | None = "targets.json"
) -> BopFrames:
    return BopFrames(root / "test", None if targets is None else root / targets, object_ids)


def scene_file(root: Path, name: str) -> Path:
    return root / "test" / "000006" / name


def edited(name: str, change: Callable[[Any], Any]) -> Callable[[Path], None]:
    """Change what a scene's file states of frame 12, or of its first instance."""

    def edit(root: Path) -> None:
        path = scene_file(root, name)
        content = json.loads(path.read_text())
        content["12"] = change(content["12"])
        if content["12"] is ...:
            del content["12"]
        path.write_text(json.dumps(content))

    return edit


def with_pose(**values: Any) -> Callable[[Path], None]:
    return edited("scene_gt.json", lambda entries: [{**entries[0], **values}])


def camera(**values: Any) -> Callable[[Path], None]:
    return edited("scene_camera.json", lambda entry: {**entry, **values})


def visible(fraction: Any) -> Callable[[Path], None]:
    return edited("scene_gt_info.json", lambda _: [{"visib_fract": fraction}])


def stated(targets: Any) -> list[tuple[int, float]]:
    return [(target.object_id, target.visible_fraction) for target in targets]


def test_keys_are_sorted_and_known_without_any_image(root, tmp_path):
    for kind in ("rgb", "depth"):
        shutil.rmtree(scene_file(root, kind))
    assert frames_of(root).keys == (SOUND, BROKEN)
    BopFrames(tmp_path / "none", tmp_path / "targets.json")  # reads nothing


def test_a_frame_comes_in_metres(root):
    """Rotations, which files state rounded, become exact."""
    with_pose(cam_R_m2c=np.round(TURN, 3).tolist(), cam_t_m2c=[10.0, -20.0, 700.0])(root)
    frame = frames_of(root).load(BROKEN)
    assert frame.key == BROKEN
    color = cv2.imread(str(scene_file(root, "rgb/000012.png")))
    np.testing.assert_array_equal(frame.rgb, color[..., ::-1])
    raw = cv2.imread(str(scene_file(root, "depth/000012.png")), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(frame.depth, raw * 1e-4, rtol=1e-6)
    np.testing.assert_array_equal(frame.camera_matrix.ravel(), K)
    (target,) = frame.targets
    assert stated([target]) == [(1, 0.05)]
    rotation = target.pose_cam_obj[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation, TURN, atol=1e-3)
    np.testing.assert_allclose(target.pose_cam_obj[:3, 3], [0.01, -0.02, 0.7])


def test_of_more_instances_the_most_visible_count_and_only_the_chosen_objects(root):
    assert stated(frames_of(root).load(SOUND).targets) == [(1, 0.9), (6, 0.7)]
    frames = frames_of(root, object_ids=[6])
    assert frames.keys == (SOUND,)
    assert stated(frames.load(SOUND).targets) == [*frames.stated_targets(SOUND)] == [(6, 0.7)]
    with pytest.raises(KeyError, match=BROKEN):
        frames.load(BROKEN)
    scene_file(root, "scene_gt_info.json").unlink()  # then nobody knows which is more visible
    targets = frames_of(root).load(SOUND).targets
    assert len(targets) == 2 and np.isnan([target.visible_fraction for target in targets]).all()


def test_what_is_no_list_of_targets_or_names_no_frame_is_an_error(root):
    with pytest.raises(ValueError, match=r"\[9\]"):
        _ = frames_of(root, object_ids=[9]).keys
    with pytest.raises(FileNotFoundError, match=r"other\.json"):
        _ = frames_of(root, targets="other.json").keys
    with pytest.raises(FileNotFoundError, match="train"):
        _ = BopFrames(root / "train", None).keys


def test_identity_changes_with_pixels_poses_and_targets(root):
    identities = [frames_of(root).identity()]
    assert frames_of(root).identity() == identities[0]
    identities.append(frames_of(root, object_ids=[1]).identity())
    image = cv2.imread(str(scene_file(root, "rgb/000000.png")))
    image[0, 0, 0] ^= 1
    cv2.imwrite(str(scene_file(root, "rgb/000000.png")), image)
    identities.append(frames_of(root).identity())
    with_pose(cam_t_m2c=[11.0, 0.0, 700.0])(root)
    identities.append(frames_of(root).identity())
    assert len(set(identities)) == 4


def test_visible_masks_are_read_by_the_number_of_the_annotation(root):
    """Of object 6 the frame's target is the third annotation, the more visible one."""
    frames = frames_of(root)
    frame = frames.load(SOUND)
    target = next(target for target in frame.targets if target.object_id == 6)
    path = scene_file(root, "mask_visib/000000_000002.png")
    mask = cv2.imread(str(path))[..., 0] > 0
    np.testing.assert_array_equal(frames.visible_mask(frame, target), mask)
    cv2.imwrite(str(path), np.zeros((30, 40), np.uint8))
    with pytest.raises(ValueError, match=r"000000_000002\.png is 40x30"):
        frames.visible_mask(frame, target)
    path.unlink()
    assert frames.visible_mask(frame, target) is None


def test_a_true_pose_lies_on_the_depth_that_was_measured(shared_data):
    frames = frames_of(shared_data / "lm", [6], "test_targets_bop19.json")
    frame = frames.load(frames.keys[0])
    (target,) = frame.targets
    vertices = load_mesh(shared_data / "lm/models/obj_000006.ply").vertices
    points = transform(target.pose_cam_obj, vertices)
    x, y = np.round(project(points, frame.camera_matrix)).astype(int).T
    # Half of the vertices face away; the front ones lie within a few mm of the measured surface.
    assert np.mean(np.abs(frame.depth[y, x] - points[:, 2]) < 0.01) > 0.35


def bad_frames(root: Path, models: Any, targets: str | None = "targets.json") -> dict[str, str]:
    frames = frames_of(root, models, targets)
    dataset: Any = SimpleNamespace(frames=frames, models=models)
    return find_bad_frames(dataset, frames.keys)


def truncated(name: str) -> Callable[[Path], None]:
    return lambda root: scene_file(root, name).write_bytes(scene_file(root, name).read_bytes()[:20])


def image(name: str, pixels: np.ndarray) -> Callable[[Path], None]:
    return lambda root: cv2.imwrite(str(scene_file(root, name)), pixels) and None


UPRIGHT = np.eye(3).ravel()
CASES = {
    "truncated colour": (truncated("rgb/000012.png"), "000012.png is truncated"),
    "truncated depth": (truncated("depth/000012.png"), "000012.png is truncated"),
    "no depth": (lambda root: scene_file(root, "depth/000012.png").unlink(), "no image"),
    "another size": (image("rgb/000012.png", np.zeros((30, 40, 3), np.uint8)), "40x30 but its"),
    "8 bits of depth": (image("depth/000012.png", np.ones((60, 80), np.uint8)), "16-bit"),
    "no camera": (edited("scene_camera.json", lambda _: ...), "frame 12: cam_K is missing"),
    "no focal length": (camera(cam_K=[0.0, *K[1:]]), "focal lengths must be finite and positive"),
    "intrinsics of a larger image": (
        camera(cam_K=[2 * value for value in K[:8]] + [1]),
        "principal point (80, 60) lies outside the image of 80x60",
    ),
    "millimetres": (camera(cam_K=[1.9, 0, 40, 0, 1.9, 30, 0, 0, 1]), "fx and fy are 1.9"),
    "no pose": (edited("scene_gt.json", lambda _: []), "1 of object 1 should be found, 0 have"),
    "null for a list": (edited("scene_gt.json", lambda _: None), "must be a list"),
    "metres": (with_pose(cam_t_m2c=[0.0, 0.0, 0.7]), "at 0.0007 m from the camera"),
    "behind the camera": (with_pose(cam_t_m2c=[0.0, 0.0, -700.0]), "at -0.7 m from the camera"),
    "micrometres": (with_pose(cam_t_m2c=[0.0, 0.0, 7e5]), "at 700 m from the camera"),
    "a reflection": (
        with_pose(cam_R_m2c=(UPRIGHT * -1).tolist()),
        "not a rotation but a reflection",
    ),
    "a visible fraction of 2": (visible(2.0), "visib_fract is 2.0: it must be at most 1"),
    "two fractions": (edited("scene_gt_info.json", lambda e: e * 2), "info.json has 2 instances"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bad_frame_is_found_alone(root: Path, models: Any, case: str) -> None:
    spoil, words = CASES[case]
    assert bad_frames(root, models) == {}
    spoil(root)
    found = bad_frames(root, models)
    assert [*found] == [BROKEN]
    assert words in found[BROKEN]


@pytest.mark.parametrize("case", ["null for a list", "no camera"])
def test_without_a_list_of_targets_a_broken_frame_is_still_one_of_the_run(
    root: Path, models: Any, case: str
) -> None:
    CASES[case][0](root)
    assert [*bad_frames(root, models, None)] == [BROKEN]


@pytest.mark.parametrize("case", ["no depth", "no pose", "no camera"])
def test_the_targets_of_a_bad_frame_are_known_and_its_identity_differs(
    root: Path, models: Any, case: str
) -> None:
    before = BopFrames(root / "test", root / "targets.json", models)
    stated, identity = before.stated_targets(BROKEN), before.identity()
    assert stated == ((1, 0.05),)
    CASES[case][0](root)
    after = BopFrames(root / "test", root / "targets.json", models)
    assert [object_id for object_id, _ in after.stated_targets(BROKEN)] == [1]
    assert after.identity() != identity


def test_a_pose_far_beyond_the_depths_is_refused(root: Path) -> None:
    with_pose(cam_t_m2c=[0.0, 0.0, 10_000.0])(root)
    with pytest.raises(DataError, match=r"places the object at 10 m .* image reaches"):
        frames_of(root).load(BROKEN)
    assert frames_of(root).read(BROKEN).targets[0].pose_cam_obj[2, 3] == 10.0


def test_frames_without_any_object_are_searched_for_all_whose_number_is_unknown(root):
    write_models(root / "models", (1, 6))
    data = BopSettings(root=str(root), split="test", targets=None, empty=str(root)).build()
    empty = data.in_empty_frames()
    assert empty is not None and empty.search_all and empty.in_empty_frames() is None
    assert empty.frames.keys == data.frames.keys and len(empty.frames.keys) == 2
    frame = empty.frames.load(SOUND)
    assert frame.targets == () and empty.instances_to_find(frame) == {1: 1, 6: 1}
    assert empty.frames_identity != data.frames_identity
    assert replace(data, empty_frames=None).in_empty_frames() is None
    with pytest.raises(MissingFileError, match=r"data\.empty"):
        BopSettings(root=str(root), split="test", targets=None, empty="nowhere").build()
