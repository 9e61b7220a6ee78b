"""LINEMOD in its first layout."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from bad_input import Case, check, of_file
from frame_files import write_dpt, write_rows
from hlp.data.file_frames import read_numbers
from hlp.data.images import read_raw_depth
from hlp.data.linemod import LinemodFrames, LinemodSettings
from hlp.objects.object_model import ObjectSettings

K = np.array([[572.4, 0, 40], [0, 573.6, 30], [0, 0, 1]])
TURN = Rotation.from_euler("xyz", [0.3, -0.2, 0.9]).as_matrix()
NAMES = {1: "ape", 6: "cat"}


@pytest.fixture
def root(tmp_path):
    for name, numbers in (("ape", (0, 2, 10)), ("cat", (0,))):
        data = tmp_path / name / "data"
        data.mkdir(parents=True)
        box = trimesh.creation.box((70, 80, 90))
        (data.parent / "mesh.ply").write_bytes(box.export(file_type="ply"))
        for number in numbers:
            color = np.full((60, 80, 3), number * 10 + 5, np.uint8)
            cv2.imwrite(str(data / f"color{number}.jpg"), color)
            write_dpt(data / f"depth{number}.dpt", np.full((60, 80), 1000 + number))
            write_rows(data / f"rot{number}.rot", TURN)
            write_rows(data / f"tra{number}.tra", np.array([[1.0], [-2.0], [100.0 + number]]))
    return tmp_path


def test_frames_come_in_numeric_order_and_in_metres(root):
    frames = LinemodFrames(root, NAMES, K)
    assert frames.keys == ("000001_000000", "000001_000002", "000001_000010", "000006_000000")
    frame = frames.load("000001_000010")
    assert frame.key == "000001_000010"
    assert frame.rgb.shape == (60, 80, 3) and abs(int(frame.rgb[5, 5, 0]) - 105) < 3
    np.testing.assert_allclose(frame.depth, 1.010, rtol=1e-6)
    np.testing.assert_array_equal(frame.camera_matrix, K)
    (target,) = frame.targets
    assert target.object_id == 1 and np.isnan(target.visible_fraction)
    np.testing.assert_allclose(target.pose_cam_obj[:3, 3], [0.01, -0.02, 1.10])
    rotation = target.pose_cam_obj[:3, :3]
    np.testing.assert_allclose(rotation, TURN, atol=1e-6)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_models_come_from_each_objects_folder(root):
    objects = {"ape": ObjectSettings(1, 80.0, 30.0), "cat": ObjectSettings(6, None, None)}
    dataset = LinemodSettings(root=str(root), objects=objects, camera_matrix=tuple(K.flat)).build()
    models = dataset.models
    assert [(key, model.name) for key, model in models.items()] == [(1, "ape"), (6, "cat")]
    assert models[6].diameter == pytest.approx(np.sqrt(0.07**2 + 0.08**2 + 0.09**2))
    assert len(models[6].symmetries) == 4  # a box: found in its shape
    with pytest.raises(ValueError, match="unit"):
        LinemodSettings(root=str(root), objects=objects, mesh_scale=1.0).build()
    key = "000006_000000"
    dataset.frames.check(key, models)
    assert [object_id for object_id, _ in dataset.frames.stated_targets(key)] == [6]
    write_rows(root / "cat/data/tra0.tra", np.array([[0.01], [-0.02], [1.0]]))
    with pytest.raises(ValueError, match=r"tra0\.tra .*translations are in centimetres"):
        dataset.frames.check(key, models)


def test_identity_changes_with_content_and_intrinsics(root):
    before = LinemodFrames(root, NAMES, K).identity()
    assert LinemodFrames(root, NAMES, K).identity() == before
    assert LinemodFrames(root, NAMES, K + 1.0).identity() != before
    write_rows(root / "cat/data/tra0.tra", np.array([[1.0], [-2.0], [100.5]]))
    assert LinemodFrames(root, NAMES, K).identity() != before


def test_absent_files_are_named(root):
    (root / "cat/data/tra0.tra").unlink()
    with pytest.raises(FileNotFoundError, match=r"tra0\.tra"):
        LinemodFrames(root, NAMES, K).load("000006_000000")
    (root / "ape/data/depth0.dpt").unlink()
    with pytest.raises(FileNotFoundError, match=r"depth0\.dpt"):
        LinemodFrames(root, NAMES, K).load("000001_000000")
    with pytest.raises(FileNotFoundError, match="duck"):
        _ = LinemodFrames(root, {9: "duck"}, K).keys
    with pytest.raises(KeyError, match="000001_000007"):
        LinemodFrames(root, NAMES, K).load("000001_000007")
    write_dpt(root / "ape/data/depth2.dpt", np.zeros((60, 80)))
    with pytest.raises(ValueError, match=r"depth2\.dpt has no depth"):
        LinemodFrames(root, NAMES, K).load("000001_000002")
    with pytest.raises(ValueError, match=r"data\.camera_matrix"):
        objects = {"ape": ObjectSettings(1)}
        LinemodSettings(root=str(root), objects=objects, camera_matrix=(1.0, 2.0)).build()


def test_depth_keeps_rows_and_columns_apart(tmp_path):
    raw = np.arange(12).reshape(3, 4)
    write_dpt(tmp_path / "a.dpt", raw)
    np.testing.assert_array_equal(read_raw_depth(tmp_path / "a.dpt"), raw)


def rot(path: Path) -> object:
    return read_numbers(path, 9, 1)


NINE = "3 3\n1 0 0\n0 1 0\n0 0 1\n"
CASES: dict[str, Case] = {
    "no rot": (lambda folder: rot(folder / "a.rot"), "no pose"),
    "dpt: short header": (of_file(read_raw_depth, "a.dpt", b"\1"), "truncated or no .dpt"),
    "dpt: too short": (
        of_file(read_raw_depth, "a.dpt", struct.pack("<ii", 2, 2) + b"\1" * 7),
        "truncated",
    ),
    "rot: ten": (of_file(rot, "a.rot", NINE + "1"), "a header line and 9 finite numbers"),
    "rot: words": (of_file(rot, "a.rot", NINE.replace("1 0 0", "x 0 0")), "not a number"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)
