"""Plain folders of RGB-D frames."""

import json

import numpy as np
import pytest

from frame_files import write_flat
from hlp.data.file_frames import RgbdFrames


@pytest.fixture
def root(tmp_path):
    for number, name in enumerate(("room-b.png", "room-a.jpg")):
        write_flat(tmp_path, name, 50 + number, 2000 + number)
    camera = {"cam_K": [500, 0, 20, 0, 500, 15, 0, 0, 1], "depth_scale": 0.5}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    return tmp_path


def test_frames_come_in_the_order_of_their_names(root):
    frames = RgbdFrames(root)
    assert frames.keys == ("000000_000000", "000000_000001")
    first = frames.load("000000_000000")
    assert first.key == "000000_000000" and first.targets == ()
    np.testing.assert_allclose(first.depth, 1.0005)
    np.testing.assert_allclose(frames.load("000000_000001").depth, 1.0)
    assert first.camera_matrix[0, 0] == 500.0


def test_identity_changes_with_the_intrinsics(root):
    before = RgbdFrames(root).identity()
    text = (root / "camera.json").read_text()
    (root / "camera.json").write_text(text.replace("500", "501", 1))
    assert RgbdFrames(root).identity() != before


def test_what_is_missing_is_named(root):
    for name in ("camera.json", "depth", "rgb"):
        (root / name).rename(root / "away")
        with pytest.raises(FileNotFoundError, match=f"has no .*{name}"):
            RgbdFrames(root)
        (root / "away").rename(root / name)
    (root / "depth" / "room-a.png").unlink()
    with pytest.raises(FileNotFoundError, match="room-a"):
        len(RgbdFrames(root))


@pytest.mark.parametrize(("folder", "count"), [("icbin/frames", 9), ("rooms", 40)])
def test_the_development_folders_load(shared_data, folder, count):
    frames = RgbdFrames(shared_data / folder)
    assert len(frames) == count
    frame = frames.load(frames.keys[-1])
    assert frame.rgb.shape == (480, 640, 3)
    assert 0.3 < np.median(frame.depth[frame.depth > 0]) < 5.0
