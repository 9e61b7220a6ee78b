"""Which files are a user's frames, and videos."""

import cv2
import numpy as np
import pytest

from hlp.data.frame_paths import (
    VideoFrames,
    count_video_frames,
    list_images,
    pair_frames,
    with_frames,
)
from hlp.errors import InputError, MissingFileError


def make(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.touch()


def pairs(folder, rgb, depth):
    found = pair_frames(str(folder / rgb), str(folder / depth))
    return [(frame.color.name, frame.depth.name) for frame in found]


def test_files_folders_and_patterns_are_paired_by_name_or_else_by_number(tmp_path):
    make(tmp_path, "a.jpg", "b.npy")
    assert pairs(tmp_path, "a.jpg", "b.npy") == [("a.jpg", "b.npy")]
    make(tmp_path, *(f"{kind}_{i}.png" for kind in ("color", "depth") for i in (10, 2, 1)))
    expected = [(f"color_{i}.png", f"depth_{i}.png") for i in (1, 2, 10)]
    assert pairs(tmp_path, "color_*.png", "depth_*.png") == expected
    make(tmp_path, "rgb/x1.jpg", "rgb/x2.jpg", "depth/x1.exr", "depth/x2.png", "depth/x3.npy")
    assert pairs(tmp_path, "rgb", "depth") == [("x1.jpg", "x1.exr"), ("x2.jpg", "x2.png")]
    make(tmp_path, "color/color_07.png", "d16/depth-7.tiff", "color/notes.txt", "color/.x.png")
    assert pairs(tmp_path, "color", "d16") == [("color_07.png", "depth-7.tiff")]
    make(tmp_path, "x1.png")
    assert pairs(tmp_path, "x1.png", "depth") == [("x1.png", "x1.exr")]


def test_the_frames_of_a_video_meet_the_sorted_depth_images(tmp_path, monkeypatch):
    monkeypatch.setattr("hlp.data.frame_paths.count_video_frames", lambda _: 3)
    make(tmp_path, "v.mp4", *(f"depth/{i}.png" for i in (9, 10, 11)))
    found = pair_frames(str(tmp_path / "v.mp4"), str(tmp_path / "depth"))
    assert [(frame.name, frame.depth.name) for frame in found] == [
        ("v_000000", "9.png"), ("v_000001", "10.png"), ("v_000002", "11.png"),
    ]  # fmt: skip
    make(tmp_path, "depth/12.png")
    with pytest.raises(ValueError, match=r"has 3 frames, depth, .*, has 4 images"):
        pairs(tmp_path, "v.mp4", "depth")


def test_what_has_no_partner_is_named(tmp_path):
    make(tmp_path, "rgb/a.png", "rgb/b.png", "depth/a.png", "c/x.png", "c/y.png")
    with pytest.raises(FileNotFoundError, match=r"depth: .* no b\.png"):
        pairs(tmp_path, "rgb", "depth")
    with pytest.raises(ValueError, match="depth is one image and rgb has 2"):
        pairs(tmp_path, "rgb", "depth/a.png")
    with pytest.raises(ValueError, match="cannot be paired"):
        pairs(tmp_path, "c", "depth")
    make(tmp_path, "r2/f_1.png", "r2/f_2.png", "d2/g_1.png")
    with pytest.raises(FileNotFoundError, match="no number 2 for"):
        pairs(tmp_path, "r2", "d2")
    make(tmp_path, "rgb/a.jpg")
    with pytest.raises(ValueError, match="one name"):
        pairs(tmp_path, "rgb", "depth")


def test_what_is_not_there_is_named(tmp_path):
    (tmp_path / "empty").mkdir()
    for given, words in (
        ("none.png", "rgb is neither an image"), ("empty", "rgb: no image in"),
        ("c_*.png", "rgb: no file is like"),
    ):  # fmt: skip
        with pytest.raises(FileNotFoundError, match=words):
            list_images(str(tmp_path / given), "rgb", (".png",))
    make(tmp_path, "a[1].png")  # a file, no pattern
    assert list_images(str(tmp_path / "a[1].png"), "rgb", (".png",)) == [tmp_path / "a[1].png"]


@pytest.mark.parametrize("camera", ["cam_K.txt", "camera.json", "scene_camera.json"])
def test_a_folder_stands_for_what_is_in_it(tmp_path, camera):
    make(tmp_path, "rgb/a.png", "depth/a.png", camera)
    assert with_frames({"frames": str(tmp_path), "learnt": "x"}) == {
        "rgb": str(tmp_path / "rgb"), "depth": str(tmp_path / "depth"), "learnt": "x",
        "intrinsics": str(tmp_path / camera),
    }  # fmt: skip
    other = with_frames({"frames": str(tmp_path), "intrinsics": "[1,2,3,4]"})
    assert other["intrinsics"] == "[1,2,3,4]"
    assert with_frames({"rgb": "a"}) == {"rgb": "a"}


def test_what_a_folder_lacks_is_named(tmp_path):
    make(tmp_path, "rgb/a.png")
    with pytest.raises(MissingFileError, match="has no depth: give depth=…"):
        with_frames({"frames": str(tmp_path)})
    make(tmp_path, "depth/a.png")
    with pytest.raises(MissingFileError, match=r"has no cam_K\.txt or camera\.json.*intrinsics=…"):
        with_frames({"frames": str(tmp_path)})
    with pytest.raises(MissingFileError, match="frames is not a folder"):
        with_frames({"frames": str(tmp_path / "none")})
    with pytest.raises(InputError, match="frames and rgb"):
        with_frames({"frames": str(tmp_path), "rgb": "x"})


def test_videos_are_read_in_order_and_again_as_rgb(tmp_path):
    """The frames differ in brightness; the codec is lossless in all but rounding."""
    path, shades = tmp_path / "v.avi", range(20, 240, 20)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
    for shade in shades:
        writer.write(np.full((48, 64, 3), (0, 0, shade), np.uint8))  # red, in OpenCV's order
    writer.release()
    assert count_video_frames(path) == len(shades)
    frames = VideoFrames(path)
    for index in (0, 1, 2, 7, 3, 3, 10):
        image = frames.read(index)
        assert image.shape == (48, 64, 3)
        assert abs(int(np.median(image[..., 0])) - shades[index]) <= 3
        assert np.median(image[..., 2]) <= 10
    with pytest.raises(ValueError, match=r"v\.avi: frame 11 cannot be read"):
        frames.read(len(shades))
    assert abs(int(np.median(frames.read(1)[..., 0])) - shades[1]) <= 3
    path.write_bytes(b"no video")
    with pytest.raises(ValueError, match=r"v\.avi is truncated or no video"):
        count_video_frames(path)
