"""Intrinsics in all forms, good and bad; distortion undone, depth of another camera."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bad_input import Case, check, of_file, written
from hlp.data.camera_files import (
    Camera,
    check_size,
    read_camera,
    resampled_depth,
    resized_camera,
    undistorted,
)

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


def camera_of(folder, name, content):
    text = content if isinstance(content, str) else json.dumps(content)
    return read_camera(str(written(folder / name, text)))


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
        ("a.json", {"intrinsic_matrix": K}, None, ()),
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
    camera = camera_of(tmp_path, name, content)
    np.testing.assert_array_equal(camera.matrix, K)
    assert (camera.size, camera.distortion, camera.fisheye) == (size, distortion, False)


def test_numbers_may_be_given_directly():
    np.testing.assert_array_equal(read_camera([600, 601, 320.5, 240.25]).matrix, K)
    np.testing.assert_array_equal(read_camera(FLAT).matrix, K)


def test_a_fisheye_has_four_coefficients(tmp_path):
    content = ROS_YAML.format(model="equidistant", coefficients=[0.1, 0.2, 0.3, 0.4])
    camera = camera_of(tmp_path, "a.yaml", content)
    assert (camera.distortion, camera.fisheye) == ((0.1, 0.2, 0.3, 0.4), True)


def test_the_depth_scale_is_read(tmp_path):
    assert camera_of(tmp_path, "a.json", {"cam_K": FLAT, "depth_scale": 0.1}).depth_scale == 0.1
    assert camera_of(tmp_path, "b.json", {"cam_K": FLAT}).depth_scale is None


def intrinsics(content: Any, name: str = "k.json") -> Any:
    text = content if isinstance(content, str | bytes) else json.dumps(content)
    return of_file(lambda path: read_camera(str(path)), name, text)


CASES: dict[str, Case] = {
    "no file": (lambda folder: read_camera(str(folder / "k.json"), "depth_intrinsics"),
                "depth_intrinsics is not a file"),
    "three numbers": (lambda _: read_camera([1, 2, 3]), "nine numbers"),
    "no focal length": (lambda _: read_camera([0, 500, 320, 240]), "be finite and positive"),
    "words": (intrinsics("fx fy cx cy", "k.txt"), "k.txt: it holds neither"),
    "no JSON": (intrinsics("{"), "k.json is not JSON"),
    "no YAML": (intrinsics("a: [", "k.yaml"), "k.yaml is not YAML"),
    "bytes": (intrinsics(b"\xff\xfe\xfa"), "is not text"),
    "deep YAML": (intrinsics("K: " + "[" * 5000, "k.yaml"), "k.yaml is nested too deeply"),
    "an alias": (intrinsics("a: &a [1, 1]\nK: [*a, *a]\n", "k.yaml"), "*name"),
    "grouped digits": (intrinsics("fx: 3_00", "k.yaml"), "3_00"),
    "grouped digits of a text": (intrinsics("3_00 0 1 0 3 1 0 0 1", "k.txt"), "neither keys"),
    "numbers of another shape": (
        intrinsics({"camera_matrix": {"rows": 4, "cols": 3, "data": FLAT}}), "must have 3 rows"
    ),
    "many keys": (intrinsics("".join(f"k{i}: 1\n" for i in range(9999)), "k.yaml"), "too long"),
    "closed before opened": (intrinsics("#" + "]" * 900 + "\nK: " + "[" * 900, "k.yaml"), "deeply"),
    "a width of true": (intrinsics({"K": FLAT, "width": True, "height": 9}), "give pixels"),
    "a scale of true": (intrinsics({"K": FLAT, "depth_scale": True}), "must be a positive"),
    "no keys": (intrinsics({}), "no cam_K"),
    "ragged": (intrinsics({"cam_K": [[1, 2, 3], [4, 5], [6]]}), "nine numbers"),
    "columns": (intrinsics({"cam_K": COLUMNS}), "row by row"),
    "Open3D by rows": (intrinsics({"intrinsic_matrix": FLAT}), "row by row"),
    "depth_scale 0": (intrinsics({"cam_K": FLAT, "depth_scale": 0}), "must be a positive number"),
    "width 0": (intrinsics({"cam_K": FLAT, "width": 0, "height": 480}), "give pixels"),
    "distortion in words": (intrinsics({"cam_K": FLAT, "D": ["a"]}), "must be numbers"),
    "huge distortion": (intrinsics({"K": FLAT, "D": [10**400, 0, 0, 0]}), "must be numbers"),
    "infinite distortion": (intrinsics('{"K": [1,1,1,1], "D": [Infinity]}'), "is no value of JSON"),
    "three coefficients": (intrinsics({"cam_K": FLAT, "D": [1, 1, 1]}), "3 distortion coeff"),
    "unknown model": (intrinsics(REALSENSE | {"coeffs": D}), "inverse_brown_conrady' cannot be"),
    "several cameras": (
        intrinsics({"0": {"cam_K": FLAT}, "1": {"cam_K": [1, *FLAT[1:]]}}), "several cameras",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)


MATRIX = np.array([[60.0, 0, 31.5], [0, 62.0, 23.5], [0, 0, 1]])
PLAIN = Camera(MATRIX)
BENT = Camera(MATRIX, distortion=(-0.3, 0.1, 0.001, -0.002, 0.0))


def test_a_bent_point_goes_back_to_where_a_straight_camera_sees_it():
    """The bent position of a ray is computed by OpenCV's projection, from the ray itself."""
    ray = np.array([[0.45, 0.3, 1.0]])
    seen, _ = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), MATRIX, np.array(BENT.distortion))
    straight = (MATRIX @ ray[0])[:2]
    across, down = np.meshgrid(np.arange(64), np.arange(48))
    away = np.hypot(across - seen[0, 0, 0], down - seen[0, 0, 1])
    assert np.linalg.norm(seen[0, 0] - straight) > 2.0
    for nearest in (False, True):
        found = undistorted(np.exp(-((away / 2.0) ** 2)).astype(np.float32), BENT, nearest)
        y, x = np.unravel_index(found.argmax(), found.shape)
        assert np.linalg.norm([x, y] - straight) < 1.0


def test_a_fisheye_is_undone_by_its_own_model():
    camera = Camera(MATRIX, distortion=(0.2, 0.0, 0.0, 0.0), fisheye=True)
    ray = np.array([0.4, 0.0, 1.0])
    angle = np.arctan(0.4)
    bent = angle * (1 + 0.2 * angle**2) * MATRIX[0, 0] + MATRIX[0, 2]
    image = np.zeros((48, 64), np.float32)
    image[:, int(np.rint(bent)) - 1 : int(np.rint(bent)) + 2] = 1.0
    found = undistorted(image, camera, nearest=True)
    assert found[24, int(np.rint((MATRIX @ ray)[0]))] == 1.0


def test_depth_of_another_camera_lands_on_the_rays_of_the_colour_pixels():
    """A slanted plane seen by both cameras from one place has one depth on each ray."""
    other = Camera(np.array([[45.0, 0, 20.0], [0, 44.0, 18.0], [0, 0, 1]]))

    def plane(matrix, shape):
        _, x = np.mgrid[: shape[0], : shape[1]]
        ray = (x - matrix[0, 2]) / matrix[0, 0]
        return (1.0 / (1.0 + 0.2 * ray)).astype(np.float32)

    found = resampled_depth(plane(other.matrix, (36, 40)), other, MATRIX, (48, 64))
    expected = plane(MATRIX, (48, 64))
    seen = found > 0
    np.testing.assert_allclose(found[seen], expected[seen], atol=0.01)
    across = (np.arange(64) - MATRIX[0, 2]) / MATRIX[0, 0] * 45 + 20
    np.testing.assert_array_equal(seen[24], (np.rint(across) >= 0) & (np.rint(across) < 40))


@pytest.mark.parametrize("factor", [2, 3])
def test_an_image_made_smaller_is_made_larger_again_pixel_by_pixel(factor):
    depth = np.random.default_rng(0).random((48 // factor, 63 // factor)).astype(np.float32)
    camera = resized_camera(MATRIX, 1 / factor, depth.shape[::-1])
    shape = (depth.shape[0] * factor, depth.shape[1] * factor)
    found = resampled_depth(depth, camera, MATRIX, shape)
    np.testing.assert_array_equal(found, np.repeat(np.repeat(depth, factor, 0), factor, 1))


def test_intrinsics_of_other_images_are_refused():
    check_size(Camera(MATRIX, (64, 48)), (48, 64, 3), Path("a.png"), "intrinsics")
    with pytest.raises(ValueError, match=r"128x96, but a\.png is 64x48: .*multiply .* by 0\.5"):
        check_size(Camera(MATRIX, (128, 96)), (48, 64, 3), Path("a.png"), "intrinsics")
    with pytest.raises(ValueError, match=r"principal point \(31\.5, 23\.5\) lies outside"):
        check_size(PLAIN, (20, 30), Path("a.png"), "intrinsics")
