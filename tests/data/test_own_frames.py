import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from hlp.data.own_frames import FilesSettings, OwnFrames, load_object_model, read_intrinsics

CAMERA = [500.0, 501.0, 20.0, 15.0]
MATRIX = [500, 0, 20, 0, 501, 15, 0, 0, 1]


@pytest.fixture
def root(tmp_path):
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
    for number, stem in enumerate(("b", "a")):
        color = np.full((30, 40, 3), 50 + number, np.uint8)
        cv2.imwrite(str(tmp_path / "rgb" / f"{stem}.jpg"), color)
        depth = np.full((30, 40), 2000 + number, np.uint16)
        cv2.imwrite(str(tmp_path / "depth" / f"{stem}.png"), depth)
    return tmp_path


def frames(root, intrinsics=CAMERA, scale=None, rgb="rgb", depth="depth"):
    return OwnFrames(root / rgb, root / depth, intrinsics, scale)


def settings(path, scale=0.001, **sizes):
    given = {"model": str(path), "rgb": "rgb", "depth": "depth", "intrinsics": CAMERA}
    return replace(FilesSettings(**given), mesh_scale=scale, **sizes)


def test_two_images_whatever_their_names_are_one_frame(root):
    source = frames(root, rgb="rgb/a.jpg", depth="depth/b.png")
    assert source.keys == ("000000_000000",) and len(source) == 1
    frame = source.load("000000_000000")
    np.testing.assert_allclose(frame.depth, 2.0)
    np.testing.assert_array_equal(frame.camera_matrix.ravel(), MATRIX)
    assert frame.targets == ()
    assert source.image(frame.key) == root / "rgb" / "a.jpg"


def test_images_of_folders_are_paired_by_name_in_order(root):
    source = frames(root)
    assert [source.image(key).name for key in source.keys] == ["a.jpg", "b.jpg"]
    np.testing.assert_allclose(source.load(source.keys[0]).depth, 2.001)
    with pytest.raises(KeyError, match="000000_000002"):
        source.load("000000_000002")


@pytest.mark.parametrize(
    "camera",
    [{"cam_K": MATRIX}, dict(zip(("fx", "fy", "cx", "cy"), CAMERA, strict=True))],
)
def test_intrinsics_of_a_file_bring_their_depth_scale(root, camera):
    (root / "camera.json").write_text(json.dumps(camera | {"depth_scale": 0.5}))
    given = str(root / "camera.json")
    matrix, scale = read_intrinsics(given)
    np.testing.assert_array_equal(matrix.ravel(), MATRIX)
    assert scale == 0.5
    np.testing.assert_allclose(frames(root, given).load("000000_000001").depth, 1.0)
    np.testing.assert_allclose(frames(root, given, 0.1).load("000000_000001").depth, 0.2)


def test_nine_numbers_are_the_matrix_row_by_row():
    np.testing.assert_array_equal(read_intrinsics([float(v) for v in MATRIX])[0].ravel(), MATRIX)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([500.0, 500.0, 20.0], "neither nine numbers"),
        ([500.0, 0.0, 0.0, 0.0, 500.0, 0.0, 20.0, 15.0, 1.0], "row by row"),
        ([-500.0, 500.0, 20.0, 15.0], "positive focal"),
        ([500.0, 500.0, 400.0, 15.0], "another size"),
    ],
)
def test_wrong_numbers_are_named(root, given, words):
    with pytest.raises(ValueError, match=rf"intrinsics.*{words}"):
        frames(root, given).load("000000_000000")


@pytest.mark.parametrize(
    "content", ["[]", '{"0": {"cam_K": []}}', '{"cam_K": 5}', '{"cam_K": ["a"]}', "{"]
)
def test_a_wrong_intrinsics_file_is_named(root, content):
    (root / "camera.json").write_text(content)
    with pytest.raises(ValueError, match=r"camera\.json"):
        read_intrinsics(str(root / "camera.json"))


def test_wrong_scales_are_named(root):
    with pytest.raises(ValueError, match="depth_scale is 0"):
        frames(root, scale=0.0).load("000000_000000")
    (root / "camera.json").write_text(json.dumps({"cam_K": MATRIX, "depth_scale": "1"}))
    with pytest.raises(ValueError, match="depth_scale must be a number"):
        frames(root, str(root / "camera.json")).load("000000_000000")


def test_what_is_missing_is_named(root):
    with pytest.raises(FileNotFoundError, match="rgb is no image"):
        len(frames(root, rgb="none"))
    with pytest.raises(FileNotFoundError, match="depth is no image"):
        len(frames(root, depth="none"))
    with pytest.raises(FileNotFoundError, match="intrinsics is no file"):
        frames(root, "none.json").load("000000_000000")
    with pytest.raises(ValueError, match="depth is one image"):
        len(frames(root, depth="depth/a.png"))
    (root / "depth" / "b.png").unlink()
    with pytest.raises(FileNotFoundError, match=r"depth: .* no b\.png"):
        len(frames(root))
    (root / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="rgb: no image"):
        len(frames(root, rgb="empty"))


def test_two_images_of_one_name_are_an_error(root):
    cv2.imwrite(str(root / "rgb" / "a.png"), np.zeros((30, 40, 3), np.uint8))
    with pytest.raises(ValueError, match="one name"):
        len(frames(root))


def test_sizes_that_differ_are_named(root):
    cv2.imwrite(str(root / "depth" / "a.png"), np.full((15, 20), 900, np.uint16))
    with pytest.raises(ValueError, match=r"a\.jpg is 40x30 but its depth image is 20x15"):
        frames(root).load("000000_000000")


def test_identity_changes_with_images_and_intrinsics(root):
    before = frames(root).identity()
    assert frames(root).identity() == before
    assert frames(root, scale=0.5).identity() != before
    assert frames(root, [501.0, *CAMERA[1:]]).identity() != before
    cv2.imwrite(str(root / "depth" / "a.png"), np.full((30, 40), 900, np.uint16))
    assert frames(root).identity() != before


def test_the_object_is_named_after_its_file_and_sized_by_rule(tmp_path):
    path = tmp_path / "bracket.ply"
    trimesh.creation.box((60.0, 90.0, 120.0)).export(path)
    model = load_object_model(settings(path))
    assert (model.object_id, model.name) == (1, "bracket")
    assert model.diameter == pytest.approx(np.hypot(np.hypot(0.06, 0.09), 0.12))
    assert model.holistic_size == pytest.approx(0.10)  # 1.08 x the middle extent, to the cm
    assert load_object_model(settings(path, holistic_size_mm=70.0)).holistic_size == 0.07


def test_a_wrong_model_is_named_with_the_key(tmp_path):
    path = tmp_path / "bracket.ply"
    with pytest.raises(FileNotFoundError, match="model is no file"):
        load_object_model(settings(path))
    trimesh.creation.box((0.06, 0.09, 0.12)).export(path)  # metres
    with pytest.raises(ValueError, match=r"bracket\.ply.*wrong unit.*mesh_scale"):
        load_object_model(settings(path))
    assert load_object_model(settings(path, scale=1.0)).diameter == pytest.approx(0.1616, abs=1e-3)
