import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from frame_files import write_flat
from hlp.data.frame_paths import FramePaths
from hlp.data.own_frames import FrameFiles, OwnFrames, SearchMasks

CAMERA = [500.0, 501.0, 20.0, 15.0]
MATRIX = [500, 0, 20, 0, 501, 15, 0, 0, 1]


@pytest.fixture
def root(tmp_path):
    for number, name in enumerate(("b.jpg", "a.jpg")):
        write_flat(tmp_path, name, 50 + number, 2000 + number)
    return tmp_path


def frames(root, intrinsics=CAMERA, rgb="rgb", depth="depth", **more):
    files = {"rgb": str(root / rgb), "depth": str(root / depth), "intrinsics": intrinsics}
    return OwnFrames(FrameFiles(**files | more))


def camera_file(root, **content):
    (root / "camera.json").write_text(json.dumps({"cam_K": MATRIX} | content))
    return str(root / "camera.json")


def test_images_of_folders_are_frames_in_order(root):
    source = frames(root)
    assert [source.paths(key).color.name for key in source.keys] == ["a.jpg", "b.jpg"]
    assert len(source) == 2
    frame = source.load(source.keys[0])
    np.testing.assert_allclose(frame.depth, 2.001)
    np.testing.assert_array_equal(frame.camera_matrix.ravel(), MATRIX)
    assert frame.targets == () and frame.key == source.keys[0]
    with pytest.raises(KeyError, match="000000_000002"):
        source.load("000000_000002")


def test_the_unit_is_given_or_stated_or_guessed_once(root, caplog):
    key = "000000_000000"
    stated = frames(root, camera_file(root, depth_scale=0.5)).load(key)
    assert stated.depth[0, 0] == pytest.approx(1.0005)
    given = frames(root, camera_file(root, depth_scale=0.5), depth_scale=0.1).load(key)
    assert given.depth[0, 0] == pytest.approx(0.2001)
    caplog.set_level("INFO", "hlp")
    source = frames(root, camera_file(root))
    for name in source.keys:
        source.load(name)
    (record,) = caplog.records
    assert record.message.startswith("depth is in millimetres")
    np.save(root / "depth.npy", np.full((30, 40), 1.5))
    frame = frames(root, rgb="rgb/a.jpg", depth="depth.npy").load(key)
    np.testing.assert_allclose(frame.depth, 1.5)
    assert "depth is in metres" in caplog.text


def test_distortion_is_undone_in_both_images_unless_it_was_before(root, caplog):
    caplog.set_level("INFO", "hlp")
    flat = np.zeros((30, 40, 3), np.uint8)
    flat[:, 30:] = 250
    cv2.imwrite(str(root / "rgb" / "a.png"), flat)
    (root / "rgb" / "a.jpg").unlink()
    cv2.imwrite(str(root / "depth" / "a.png"), np.where(flat[..., 0] > 0, 900, 700).astype("u2"))
    bent = camera_file(root, fx=1, distortion=[-40.0, 0, 0, 0])
    given = {"intrinsics": bent, "rgb": "rgb/a.png", "depth": "depth/a.png"}
    straight = frames(root, **given, undistort=False).load("000000_000000")
    np.testing.assert_array_equal(straight.rgb, flat)
    assert "taken to be undone already" in caplog.text
    undone = frames(root, **given).load("000000_000000")
    assert (undone.rgb != flat).any()
    bright, far = undone.rgb[..., 0] > 125, undone.depth > 0.8
    assert (bright == far).mean() > 0.97
    assert set(np.rint(undone.depth * 1000).astype(int).ravel()) <= {0, 700, 900}


def test_depth_of_another_size_needs_its_camera_or_the_scale(root):
    small = np.arange(15 * 20, dtype=np.uint16).reshape(15, 20) + 900
    cv2.imwrite(str(root / "depth" / "a.png"), small)
    with pytest.raises(ValueError, match=r"a\.jpg is 40x30 but its depth image is 20x15.*resize"):
        frames(root).load("000000_000000")
    scaled = frames(root, depth_resize=2.0).load("000000_000000")
    large = np.repeat(np.repeat(small, 2, 0), 2, 1) / 1000.0
    np.testing.assert_allclose(scaled.depth, large, rtol=1e-6)
    half = [250.0, 250.5, 9.75, 7.25]  # the centre of the first pixel is half a pixel from the edge
    seen = frames(root, depth_intrinsics=half).load("000000_000000")
    np.testing.assert_array_equal(seen.depth, scaled.depth)
    with pytest.raises(ValueError, match="give one of them"):
        frames(root, depth_intrinsics=half, depth_resize=2.0)


def test_a_video_and_a_folder_of_depth(root):
    writer = cv2.VideoWriter(str(root / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (40, 30))
    for shade in (40, 200):
        writer.write(np.full((30, 40, 3), shade, np.uint8))
    writer.release()
    source = frames(root, rgb="v.avi")
    shades = [int(source.load(key).rgb.mean()) for key in source.keys]
    np.testing.assert_allclose(shades, [40, 200], atol=3)
    assert [source.paths(key).name for key in source.keys] == ["v_000000", "v_000001"]


FRAME = FramePaths(Path("rgb/a.png"), Path("depth/a.png"))


def test_a_box_is_x_y_width_height_cut_at_the_border():
    mask = SearchMasks(box=(3, 2, 4, 5)).load(FRAME, (20, 10))
    expected = np.zeros((20, 10), bool)
    expected[2:7, 3:7] = True
    np.testing.assert_array_equal(mask, expected)
    assert SearchMasks(box=(-5, -5, 7, 6)).load(FRAME, (20, 10)).sum() == 2
    with pytest.raises(ValueError, match="lies outside"):
        SearchMasks(box=(30, 2, 4, 5)).load(FRAME, (20, 10))


def test_a_mask_is_what_is_not_black(tmp_path):
    image = np.zeros((20, 10), np.uint8)
    with pytest.raises(FileNotFoundError, match=r"has no a\.png|no image in"):
        SearchMasks(str(tmp_path)).load(FRAME, (20, 10))
    cv2.imwrite(str(tmp_path / "b.png"), image)
    with pytest.raises(FileNotFoundError, match=r"has no a\.png"):
        SearchMasks(str(tmp_path)).load(FRAME, (20, 10))
    with pytest.raises(ValueError, match="must be alike"):
        SearchMasks(str(tmp_path / "b.png")).load(FRAME, (10, 10))
    with pytest.raises(ValueError, match="marks no pixel"):
        SearchMasks(str(tmp_path / "b.png")).load(FRAME, (20, 10))
    image[5:8, 2:4] = 1
    cv2.imwrite(str(tmp_path / "a.png"), image)
    cv2.imwrite(str(tmp_path / "b.png"), np.dstack([image * 0, image * 9, image * 0]))
    for given in (tmp_path, tmp_path / "a.png", tmp_path / "b.png"):
        np.testing.assert_array_equal(SearchMasks(str(given)).load(FRAME, (20, 10)), image > 0)
