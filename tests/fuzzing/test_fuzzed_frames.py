"""Whatever stands in the files of a data set: a result, or an error that names the file."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from spoiled_files import is_clean, spoiled

from hlp import schemas
from hlp.data.bop_models import name_objects, symmetry_motions
from hlp.data.bop_scenes import list_scenes, list_targets, most_visible
from hlp.data.camera_files import read_camera
from hlp.data.file_frames import read_numbers
from hlp.data.images import read_raw_depth
from hlp.data.ycbineoat import read_pose
from hlp.errors import DataError
from hlp.schemas import camera_matrix
from hlp.settings import read_as

K = [500.0, 0, 40, 0, 510.0, 30, 0, 0, 1]
POSE = {"obj_id": 1, "cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [1.0, 0, 700]}
CAMERAS = {"0": {"cam_K": K, "depth_scale": 0.1}, "12": {"cam_K": K, "depth_scale": 0.1}}
SCENE = {
    "scene_camera.json": CAMERAS,
    "scene_gt.json": {"0": [POSE, {**POSE, "obj_id": 6}], "12": [POSE]},
    "scene_gt_info.json": {"0": [{"visib_fract": 0.9}, {"visib_fract": 0.1}], "12": []},
}
TARGETS = [{"scene_id": 6, "im_id": 0, "obj_id": 1, "inst_count": 1}, {"scene_id": 6, "im_id": 12}]
MODELS = {
    "1": {
        "diameter": 102.1,
        "symmetries_discrete": [np.diag([-1.0, -1, 1, 1]).ravel().tolist()],
        "symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}],
    },
    "6": {"diameter": 90},
}


def written(value):
    return json.dumps(value).encode()


def read_scene(folder):
    """All that is read of a scene's text files."""
    scenes = list_scenes(folder.parent)
    for frame in (0, 12):
        scene = scenes[6]
        camera_matrix(scene.camera(frame).cam_K, f"{folder}/scene_camera.json", (80, 60))
        most_visible(scene.targets(frame), {1: 1}, scene.where(frame))


@pytest.mark.parametrize("name", SCENE)
@given(data=st.data())
def test_scenes(tmp_path, name, data):
    folder = tmp_path / "test" / "000006"
    folder.mkdir(parents=True, exist_ok=True)
    for each, content in SCENE.items():
        (folder / each).write_bytes(written(content))
    if name == "scene_gt.json":  # it may state other instances than the fractions
        (folder / "scene_gt_info.json").unlink()
    (folder / name).write_bytes(data.draw(spoiled(written(SCENE[name]))))
    is_clean(lambda: read_scene(folder), folder / name)
    # Which frames there are is known whatever stands in them.
    is_clean(lambda: list_targets(list_scenes(folder.parent), None, 0.1), folder / name)


@given(spoiled(written(TARGETS)))
def test_targets(tmp_path, content):
    path = tmp_path / "test_targets.json"
    path.write_bytes(content)
    is_clean(lambda: list_targets({}, path, 0.1), path)


@given(spoiled(written(MODELS)))
@example(written(MODELS).replace(b'"axis": [0,', b'"axis": [1e+300,'))
def test_models_info(tmp_path, content):
    path = tmp_path / "models_info.json"
    path.write_bytes(content)

    def read():
        for info in read_as(path, schemas.ModelInfos).values():
            motions = symmetry_motions(info, 8, str(path))
            assert np.isfinite(motions).all()

    is_clean(read, path)


@given(spoiled(written({"1": "ape", "6": "cat"})))
def test_names(tmp_path, content):
    path = tmp_path / "models" / "names.json"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    is_clean(lambda: name_objects(tmp_path, [1, 6]), path)


OPENCV = """%YAML:1.0
---
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 40., 0., 510., 30., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, 0., 0., 0., 0. ]
image_width: 80
image_height: 60
"""
ROS = {"width": 80, "height": 60, "K": K, "D": [0.1, 0, 0, 0, 0], "distortion_model": "plumb_bob"}
INTRINSICS = {
    "bop.json": written(CAMERAS),
    "camera.json": written({"cam_K": K, "depth_scale": 0.1}),
    "ros.json": written(ROS),
    "realsense.json": written(
        {"intrinsics": {"fx": 5, "fy": 5, "ppx": 4, "ppy": 3, "coeffs": [0] * 5, "model": "none"}}
    ),
    "open3d.json": written({"intrinsic_matrix": K, "width": 80, "height": 60}),
    "ros.yaml": b"width: 80\nheight: 60\nk: [500, 0, 40, 0, 510, 30, 0, 0, 1]\nd: []\n---\n",
    "opencv.yaml": OPENCV.encode(),
    "cam_K.txt": b"500 0 40\n0 510 30\n0 0 1\n",
}


@pytest.mark.parametrize("name", INTRINSICS)
@given(data=st.data())
def test_intrinsics(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data.draw(spoiled(INTRINSICS[name])))

    def read():
        camera = read_camera(str(path))
        assert np.isfinite(camera.matrix).all() and (np.diag(camera.matrix) > 0).all()
        assert np.isfinite(camera.distortion).all()

    is_clean(read, path)


DPT = np.array([3, 4], "<i4").tobytes() + np.arange(12, dtype="<u2").tobytes()
ROT = b"3 3\n1 0 0\n0 1 0\n0 0 1\n"
NUMBERS: dict[str, tuple[bytes, Callable[[Path], np.ndarray]]] = {
    "depth0.dpt": (DPT, lambda path: read_raw_depth(path)),
    "rot0.rot": (ROT, lambda path: read_numbers(path, 9, 1)),
    "tra0.tra": (b"1 3\n1.5\n-2\n100\n", lambda path: read_numbers(path, 3, 1)),
    "0000.txt": (b"1 0 0 0.1\n0 1 0 0.2\n0 0 1 0.9\n0 0 0 1\n", read_pose),
}


@pytest.mark.parametrize("name", NUMBERS)
@given(data=st.data())
def test_linemod_s_and_ycbineoat_s_files(tmp_path, name, data):
    content, read = NUMBERS[name]
    path = tmp_path / name
    path.write_bytes(data.draw(spoiled(content)))
    is_clean(lambda: np.testing.assert_array_equal(np.isfinite(read(path)), True), path)


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1), st.integers(0, 40))
@example(65536, 65536, 0)
@example(-3, -4, 24)
def test_sizes_that_a_dpt_states(tmp_path, rows, columns, length):
    path = tmp_path / "depth0.dpt"
    path.write_bytes(np.array([rows, columns], "<i4").tobytes() + b"\1" * length)
    if rows > 0 and columns > 0 and 2 * rows * columns == length:
        assert read_raw_depth(path).shape == (rows, columns)
    else:
        with pytest.raises(DataError, match=r"depth0\.dpt is truncated"):
            read_raw_depth(path)
