import json

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.data.bop import BopFrames
from hlp.data.bop_scenes import list_scenes
from hlp.data.bop_targets import annotated_targets, list_targets
from hlp.geometry import project, transform
from hlp.objects.meshes import load_mesh

K = [500.0, 0, 40, 0, 510.0, 30, 0, 0, 1]
TURN = Rotation.from_euler("xyz", [0.3, -0.2, 0.9]).as_matrix()


def _entry(object_id, x=10.0):
    return {"obj_id": object_id, "cam_R_m2c": TURN.ravel().tolist(), "cam_t_m2c": [x, -20.0, 700.0]}


def _change(path, edit):
    content = json.loads(path.read_text())
    path.write_text(json.dumps(edit(content) or content))


@pytest.fixture
def root(tmp_path):
    scene = tmp_path / "test" / "000006"
    for kind in ("rgb", "depth"):
        (scene / kind).mkdir(parents=True)
    rng = np.random.default_rng(0)
    for frame, extension in ((0, "png"), (12, "jpg")):
        color = rng.integers(0, 256, (60, 80, 3)).astype(np.uint8)
        cv2.imwrite(str(scene / "rgb" / f"{frame:06d}.{extension}"), color)
        depth = rng.integers(6000, 9000, (60, 80)).astype(np.uint16)
        cv2.imwrite(str(scene / "depth" / f"{frame:06d}.png"), depth)
    camera = {"cam_K": K, "depth_scale": 0.1}
    truth = [_entry(1), _entry(6, 30.0), _entry(6, 60.0)]
    visible = [{"visib_fract": value} for value in (0.9, 0.2, 0.7)]
    files = {
        "scene_camera.json": {"0": camera, "12": camera},
        "scene_gt.json": {"0": truth, "12": truth[:1]},
        "scene_gt_info.json": {"0": visible, "12": visible[:1]},
    }
    for name, content in files.items():
        (scene / name).write_text(json.dumps(content))
    targets = [
        {"scene_id": 6, "im_id": 12, "obj_id": 1, "inst_count": 1},
        {"scene_id": 6, "im_id": 0, "obj_id": 1, "inst_count": 1},
        {"scene_id": 6, "im_id": 0, "obj_id": 6, "inst_count": 1},
    ]
    (tmp_path / "targets.json").write_text(json.dumps(targets))
    return tmp_path


def _frames(root, **options):
    return BopFrames(root, "test", "targets.json", **options)


def _scene(root, name):
    return root / "test" / "000006" / name


def test_targets_are_listed_by_frame(root):
    assert list_targets(list_scenes(root / "test"), root / "targets.json") == {
        (6, 12): {1: 1},
        (6, 0): {1: 1, 6: 1},
    }


def test_without_a_list_all_that_is_annotated_counts(root):
    assert list_targets(list_scenes(root / "test"), None) == {(6, 0): {1: 1, 6: 2}, (6, 12): {1: 1}}


def test_keys_are_sorted_and_known_without_any_image(root):
    for path in [*(_scene(root, "rgb")).iterdir(), *(_scene(root, "depth")).iterdir()]:
        path.unlink()
    frames = _frames(root)
    assert frames.keys == ("000006_000000", "000006_000012")
    assert len(frames) == 2


def test_constructing_reads_nothing(tmp_path):
    BopFrames(tmp_path / "none", "test", "targets.json")


def test_a_frame_comes_in_metres(root):
    frame = _frames(root).load("000006_000012")
    assert frame.key == "000006_000012"
    assert frame.rgb.shape == (60, 80, 3)
    raw = cv2.imread(str(_scene(root, "depth") / "000012.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(frame.depth, raw * 1e-4, rtol=1e-6)
    np.testing.assert_array_equal(frame.camera_matrix.ravel(), K)
    (target,) = frame.targets
    assert (target.object_id, target.visible_fraction) == (1, 0.9)
    np.testing.assert_allclose(target.pose_cam_obj[:3, :3], TURN, atol=1e-12)
    np.testing.assert_allclose(target.pose_cam_obj[:3, 3], [0.01, -0.02, 0.7])


def test_of_more_instances_than_wanted_the_most_visible_count(root):
    targets = _frames(root).load("000006_000000").targets
    assert [(target.object_id, target.visible_fraction) for target in targets] == [
        (1, 0.9),
        (6, 0.7),
    ]


def test_only_the_chosen_objects_are_targets(root):
    frames = _frames(root, object_ids=[6])
    assert frames.keys == ("000006_000000",)
    assert [target.object_id for target in frames.load("000006_000000").targets] == [6]
    with pytest.raises(KeyError, match="000006_000012"):
        frames.load("000006_000012")
    with pytest.raises(ValueError, match=r"\[9\]"):
        _ = _frames(root, object_ids=[9]).keys


def test_all_annotations_of_a_frame_can_be_read(root):
    targets = annotated_targets(list_scenes(root / "test")[6], 0, "here")
    assert [target.object_id for target in targets] == [1, 6, 6]


def test_visibility_is_nan_where_the_set_does_not_say(root):
    _scene(root, "scene_gt_info.json").unlink()
    targets = _frames(root).load("000006_000000").targets
    assert all(np.isnan(target.visible_fraction) for target in targets)
    assert len(targets) == 2


def test_rounded_rotations_become_rotations(root):
    def rounded(content):
        for entry in content["12"]:
            entry["cam_R_m2c"] = np.round(entry["cam_R_m2c"], 3).tolist()

    _change(_scene(root, "scene_gt.json"), rounded)
    rotation = _frames(root).load("000006_000012").targets[0].pose_cam_obj[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation, TURN, atol=1e-3)


@pytest.mark.parametrize(
    ("key", "values", "message"),
    [
        ("cam_t_m2c", [0.0, float("nan"), 700.0], r"0\.cam_t_m2c\.1 is nan.*finite"),
        ("cam_R_m2c", [float("nan")] * 9, r"0\.cam_R_m2c\.0 is nan"),
        ("cam_R_m2c", (-TURN).ravel().tolist(), "object 1: cam_R_m2c is no rotation but a refl"),
        ("cam_R_m2c", (2 * TURN).ravel().tolist(), "no rotation"),
        ("cam_R_m2c", [1.0, 2.0], "cam_R_m2c has 2 numbers, it must have 9"),
        ("cam_t_m2c", None, "cam_t_m2c is null: it must be a list"),
    ],
)
def test_a_broken_pose_is_an_error_that_names_frame_and_object(root, key, values, message):
    def broken(content):
        content["12"][0][key] = values

    _change(_scene(root, "scene_gt.json"), broken)
    with pytest.raises(ValueError, match=message) as caught:
        _frames(root).load("000006_000012")
    assert "frame 12" in str(caught.value)


@pytest.mark.parametrize("name", ["rgb/000000.png", "depth/000012.png", "rgb/000012.jpg"])
def test_a_truncated_image_is_an_error_that_names_the_file(root, name):
    path = _scene(root, name)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match="truncated") as caught:
        _frames(root).load(f"000006_{path.stem}")
    assert str(path) in str(caught.value)


def test_an_absent_image_and_an_absent_scene_are_named(root):
    _scene(root, "depth/000012.png").unlink()
    with pytest.raises(FileNotFoundError, match=r"depth.000012\.png"):
        _frames(root).load("000006_000012")
    _scene(root, "scene_camera.json").unlink()
    with pytest.raises(FileNotFoundError, match=r"scene_camera\.json"):
        _frames(root).load("000006_000000")


def test_depth_of_another_size_is_an_error(root):
    cv2.imwrite(str(_scene(root, "depth/000012.png")), np.ones((30, 40), np.uint16))
    with pytest.raises(ValueError, match=r"80x60.*40x30"):
        _frames(root).load("000006_000012")


def test_a_target_without_a_pose_is_an_error(root):
    _change(_scene(root, "scene_gt.json"), lambda content: {**content, "12": []})
    with pytest.raises(ValueError, match="frame 12: 1 of object 1"):
        _frames(root).load("000006_000012")


def test_a_frame_without_intrinsics_is_an_error(root):
    _change(_scene(root, "scene_camera.json"), lambda content: {"0": content["0"]})
    with pytest.raises(ValueError, match="no cam_K for frame 12"):
        _frames(root).load("000006_000012")


def test_what_is_no_targets_file_is_an_error(root):
    (root / "targets.json").write_text('{"6": [1, 2]}')
    with pytest.raises(ValueError, match=r"targets\.json: the content is .*a list"):
        _ = _frames(root).keys
    with pytest.raises(FileNotFoundError, match=r"other\.json"):
        _ = BopFrames(root, "test", "other.json").keys
    with pytest.raises(FileNotFoundError, match="train"):
        _ = BopFrames(root, "train", None).keys


def test_identity_changes_with_pixels_poses_and_targets(root):
    identities = [_frames(root).identity()]
    assert _frames(root).identity() == identities[0]
    identities.append(_frames(root, object_ids=[1]).identity())
    image = cv2.imread(str(_scene(root, "rgb/000000.png")))
    image[0, 0, 0] ^= 1
    cv2.imwrite(str(_scene(root, "rgb/000000.png")), image)
    identities.append(_frames(root).identity())
    _change(_scene(root, "scene_gt.json"), lambda content: {**content, "12": [_entry(1, 11.0)]})
    identities.append(_frames(root).identity())
    assert len(set(identities)) == 4


def test_the_development_frames_hold_all_their_targets(shared_data):
    frames = BopFrames(shared_data / "lm", "test", "test_targets_bop19.json")
    assert len(frames) == 202
    assert sum(sum(wanted.values()) for wanted in frames.targets.values()) == 1309
    assert frames.keys[0] == "000006_000000" and frames.keys[-1] == "000008_000004"


def test_a_true_pose_lies_on_the_depth_that_was_measured(shared_data):
    frames = BopFrames(shared_data / "lm", "test", "test_targets_bop19.json", [6])
    frame = frames.load(frames.keys[0])
    (target,) = frame.targets
    vertices = load_mesh(shared_data / "lm/models/obj_000006.ply").vertices
    points = transform(target.pose_cam_obj, vertices)
    x, y = np.round(project(points, frame.camera_matrix)).astype(int).T
    # Half of the vertices face away; the front ones lie within a few mm of the measured surface.
    apart = np.abs(frame.depth[y, x] - points[:, 2])
    assert np.mean(apart < 0.01) > 0.35


@pytest.mark.slow
def test_every_development_frame_loads(shared_data):
    frames = BopFrames(shared_data / "lm", "test", "test_targets_bop19.json")
    assert sum(len(frames.load(key).targets) for key in frames.keys) == 1309


def test_visible_masks_are_read_by_the_number_of_the_annotation(root):
    """Of object 6 the frame's target is the third annotation, the more visible one."""
    frames = _frames(root)
    frame = frames.load("000006_000000")
    target = next(target for target in frame.targets if target.object_id == 6)
    assert frames.visible_mask(frame, target) is None
    folder = _scene(root, "mask_visib")
    folder.mkdir()
    masks = np.random.default_rng(1).random((3, 60, 80)) < 0.2
    for number, mask in enumerate(masks):
        cv2.imwrite(str(folder / f"000000_{number:06d}.png"), mask.astype(np.uint8) * 255)
    np.testing.assert_array_equal(frames.visible_mask(frame, target), masks[2])
    cv2.imwrite(str(folder / "000000_000002.png"), np.zeros((30, 40), np.uint8))
    with pytest.raises(ValueError, match=r"000000_000002\.png is 40x30"):
        frames.visible_mask(frame, target)
