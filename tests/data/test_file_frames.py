"""Plain folders of RGB-D frames."""

import json

import cv2
import numpy as np
import pytest

from hlp.data.file_frames import RgbdFrames


@pytest.fixture
def root(tmp_path):
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
    for number, name in enumerate(("room-b.png", "room-a.jpg")):
        cv2.imwrite(str(tmp_path / "rgb" / name), np.full((30, 40, 3), 50 + number, np.uint8))
        depth = np.full((30, 40), 2000 + number, np.uint16)
        cv2.imwrite(str(tmp_path / "depth" / f"{name[:-4]}.png"), depth)
    camera = {"cam_K": [500, 0, 20, 0, 500, 15, 0, 0, 1], "depth_scale": 0.5}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    return tmp_path


def test_frames_come_in_the_order_of_their_names(root):
    frames = RgbdFrames(root)
    assert frames.keys == ("000000_000000", "000000_000001") and len(frames) == 2
    first = frames.load("000000_000000")
    assert first.key == "000000_000000" and first.targets == ()
    assert frames.stated_targets(first.key) == ()
    np.testing.assert_allclose(first.depth, 1.0005)
    np.testing.assert_allclose(frames.load("000000_000001").depth, 1.0)
    assert first.camera_matrix[0, 0] == 500.0


def test_identity_changes_with_the_intrinsics(root):
    before = RgbdFrames(root).identity()
    text = (root / "camera.json").read_text()
    (root / "camera.json").write_text(text.replace("500", "501", 1))
    assert RgbdFrames(root).identity() != before


def test_what_is_missing_is_named(root):
    with pytest.raises(KeyError, match="000000_000009"):
        RgbdFrames(root).load("000000_000009")
    wrong = (
        ({}, "cam_K is missing"),
        ({"cam_K": ["a"] * 9}, "cam_K.0 is 'a'"),
        ({"cam_K": [0] * 9}, "cam_K is .* must be finite and positive"),
    )
    for camera, words in wrong:
        (root / "camera.json").write_text(json.dumps(camera))
        with pytest.raises(ValueError, match=rf"camera\.json: {words}"):
            RgbdFrames(root).load("000000_000000")
    (root / "depth" / "room-a.png").unlink()
    with pytest.raises(FileNotFoundError, match="room-a"):
        len(RgbdFrames(root))
    for path in (root / "rgb").iterdir():
        path.unlink()
    with pytest.raises(FileNotFoundError, match="no image"):
        len(RgbdFrames(root))
    with pytest.raises(FileNotFoundError, match="rgb is neither an image nor a folder"):
        len(RgbdFrames(root / "rgb"))


@pytest.mark.parametrize(("folder", "count"), [("icbin/frames", 9), ("rooms", 40)])
def test_the_development_folders_load(shared_data, folder, count):
    frames = RgbdFrames(shared_data / folder)
    assert len(frames) == count
    frame = frames.load(frames.keys[-1])
    assert frame.rgb.shape == (480, 640, 3)
    assert 0.3 < np.median(frame.depth[frame.depth > 0]) < 5.0
