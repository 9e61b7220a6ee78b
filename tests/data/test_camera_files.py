import json

import numpy as np
import pytest

from hlp.data.camera_files import read_camera

K = [[600.0, 0, 320.5], [0, 601.0, 240.25], [0, 0, 1]]
FLAT = [value for row in K for value in row]
COLUMNS = [K[row][column] for column in range(3) for row in range(3)]
D = [0.1, -0.2, 0.001, 0.002, 0.05]
ROS_YAML = """\
image_width: 640
image_height: 480
camera_name: camera
camera_matrix:
  rows: 3
  cols: 3
  data: [600.0, 0, 320.5, 0, 601.0, 240.25, 0, 0, 1]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: 5
  data: {coefficients}
"""
OPENCV = """\
%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600.0, 0., 320.5, 0., 601.0, 240.25, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, -0.2, 0.001, 0.002, 0.05 ]
"""
REALSENSE = {
    "width": 640, "height": 480, "fx": 600.0, "fy": 601.0, "ppx": 320.5, "ppy": 240.25,
    "model": "distortion.inverse_brown_conrady", "coeffs": [0.0] * 5,
}  # fmt: skip
ROS_MESSAGE = {
    "header": {"frame_id": "c"}, "height": 480, "width": 640, "distortion_model": "plumb_bob",
    "D": D, "K": FLAT, "R": [1, 0, 0, 0, 1, 0, 0, 0, 1], "P": [0] * 12,
}  # fmt: skip


def written(folder, name, content):
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(path)


@pytest.mark.parametrize(
    ("name", "content", "size", "distortion"),
    [
        ("a.json", {"cam_K": FLAT}, None, ()),
        ("a.json", {"fx": 600, "fy": 601, "cx": 320.5, "cy": 240.25, "width": 640, "height": 480},
         (640, 480), ()),
        ("a.yaml", "fx: 600\nfy: 601\ncx: 320.5\ncy: 240.25\n", None, ()),
        ("a.json", REALSENSE, (640, 480), ()),
        ("a.json", REALSENSE | {"model": "Brown Conrady", "coeffs": D}, (640, 480), tuple(D)),
        ("a.json", {"width": 640, "height": 480, "intrinsic_matrix": COLUMNS}, (640, 480), ()),
        ("a.json", {"class_name": "PinholeCameraParameters", "extrinsic": [],
                    "intrinsic": {"width": 640, "height": 480, "intrinsic_matrix": COLUMNS}},
         (640, 480), ()),
        ("a.yaml", ROS_YAML.format(model="plumb_bob", coefficients=D), (640, 480), tuple(D)),
        ("a.json", ROS_MESSAGE, (640, 480), tuple(D)),
        ("a.yaml", json.dumps({"k": FLAT, "d": [], "width": 640, "height": 480}) + "\n---\n",
         (640, 480), ()),
        ("a.yml", OPENCV, (640, 480), tuple(D)),
        ("K.txt", "600 0 320.5\n0 601 240.25\n0 0 1\n", None, ()),
        ("K.txt", "600.0, 601.0, 320.5, 240.25", None, ()),
        ("K.txt", "[[600, 0, 320.5], [0, 601, 240.25], [0, 0, 1]]", None, ()),
        ("scene_camera.json", {"0": {"cam_K": FLAT, "cam_t_w2c": [1]}, "7": {"cam_K": FLAT}},
         None, ()),
    ],
)  # fmt: skip
def test_every_form_gives_the_same_matrix(tmp_path, name, content, size, distortion):
    camera = read_camera(written(tmp_path, name, content))
    np.testing.assert_array_equal(camera.matrix, K)
    assert (camera.size, camera.distortion, camera.fisheye) == (size, distortion, False)


def test_numbers_may_be_given_directly():
    np.testing.assert_array_equal(read_camera([600, 601, 320.5, 240.25]).matrix, K)
    np.testing.assert_array_equal(read_camera(FLAT).matrix, K)


def test_a_fisheye_has_four_coefficients(tmp_path):
    content = ROS_YAML.format(model="equidistant", coefficients=[0.1, 0.2, 0.3, 0.4])
    camera = read_camera(written(tmp_path, "a.yaml", content))
    assert (camera.distortion, camera.fisheye) == ((0.1, 0.2, 0.3, 0.4), True)


def test_the_depth_scale_is_read(tmp_path):
    path = written(tmp_path, "a.json", {"cam_K": FLAT, "depth_scale": 0.1})
    assert read_camera(path).depth_scale == 0.1
    assert read_camera(written(tmp_path, "b.json", {"cam_K": FLAT})).depth_scale is None


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.json", "{", "is no JSON"),
        ("a.json", "[]", "neither|nine"),
        ("a.json", {"width": 3}, "no cam_K"),
        ("a.json", {"0": {"cam_K": []}}, "nine numbers"),
        ("a.json", {"0": {"cam_K": FLAT}, "1": {"cam_K": [1, *FLAT[1:]]}}, "several cameras"),
        ("a.json", {"cam_K": 5}, "nine numbers"),
        ("a.json", {"cam_K": ["a"] * 9}, "numbers"),
        ("a.json", {"cam_K": COLUMNS}, "row by row"),
        ("a.json", {"intrinsic_matrix": FLAT}, "row by row"),
        ("a.json", {"cam_K": [-600, *FLAT[1:]]}, "positive focal"),
        ("a.json", {"cam_K": FLAT, "depth_scale": "1"}, "depth_scale must be"),
        ("a.json", {"cam_K": FLAT, "depth_scale": 0}, "depth_scale must be"),
        ("a.json", {"cam_K": FLAT, "width": 0, "height": 4}, "width and height"),
        ("a.json", REALSENSE | {"coeffs": D}, "inverse_brown_conrady.*rectify the images"),
        ("a.json", ROS_MESSAGE | {"D": [0.1, 0.2]}, "2 distortion coefficients"),
        ("a.json", ROS_MESSAGE | {"D": "none"}, "distortion must be numbers"),
        ("K.txt", "600 0 320 0 601", "nine numbers"),
        ("K.txt", "hello", "holds neither"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_the_file(tmp_path, name, content, words):
    with pytest.raises(ValueError, match=rf"(?s)intrinsics, .*{name[0]}\.\w+.*({words})"):
        read_camera(written(tmp_path, name, content))


def test_a_missing_file_is_named_with_its_key(tmp_path):
    with pytest.raises(FileNotFoundError, match="depth_intrinsics is no file"):
        read_camera(str(tmp_path / "none.json"), "depth_intrinsics")
