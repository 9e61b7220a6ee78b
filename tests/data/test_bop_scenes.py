"""BOP's image-wise layout gives the same frames as the classic one."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from bop_folder import make_imagewise, write_scene
from hlp.data.bop import BopFrames
from hlp.data.bop_scenes import list_scenes
from hlp.errors import DataError, MissingFileError


@pytest.fixture
def classic(tmp_path: Path) -> Path:
    write_scene(tmp_path / "test")
    return tmp_path


# The folder of the files and what their names begin with.
LAYOUTS = {"in the split": (".", "000006_"), "in a folder of the scene": ("000006", "")}
LAYOUTS["in a folder of the scene, with its number"] = ("000006", "000006_")


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_both_layouts_give_the_same_frames(classic, tmp_path, layout):
    folder, prefix = layout
    make_imagewise(classic / "test" / "000006", tmp_path / "single" / folder, prefix)
    expected, found = BopFrames(classic, "test", None), BopFrames(tmp_path, "single", None)
    assert found.keys == expected.keys == ("000006_000000", "000006_000012")
    assert found.targets == expected.targets
    for key in expected.keys:
        a, b = expected.load(key), found.load(key)
        np.testing.assert_array_equal(a.rgb, b.rgb)
        np.testing.assert_array_equal(a.depth, b.depth)
        np.testing.assert_array_equal(a.camera_matrix, b.camera_matrix)
        for one, other in zip(a.targets, b.targets, strict=True):
            assert (one.object_id, one.visible_fraction) == (
                other.object_id,
                other.visible_fraction,
            )
            np.testing.assert_array_equal(one.pose_cam_obj, other.pose_cam_obj)
            mask = expected.visible_mask(a, one)
            np.testing.assert_array_equal(found.visible_mask(b, other), mask)


def test_the_identity_follows_the_content_of_single_files(classic, tmp_path):
    make_imagewise(classic / "test" / "000006", tmp_path / "single", "000006_")
    before = BopFrames(tmp_path, "single", None).identity()
    path = tmp_path / "single" / "000006_000012.gt.json"
    path.write_text(path.read_text().replace("700", "701"))
    assert BopFrames(tmp_path, "single", None).identity() != before


@pytest.mark.parametrize("color", ["gray/tif", "gray/png", "rgb/jpg"])
def test_grey_images_and_other_extensions_are_read(tmp_path, color):
    write_scene(tmp_path / "test", color)
    frames = BopFrames(tmp_path, "test", None)
    frame = frames.load(frames.keys[0])
    assert frame.rgb.shape == (60, 80, 3)
    if color.startswith("gray"):
        assert (frame.rgb == frame.rgb[..., :1]).all()
    assert frames.identity()


def test_scene_folders_may_have_any_number_of_digits(classic):
    shutil.move(classic / "test" / "000006", classic / "test" / "6")
    (classic / "test" / "notes").mkdir()
    assert BopFrames(classic, "test", None).keys[0] == "000006_000000"


def test_what_is_absent_is_named(classic, tmp_path):
    make_imagewise(classic / "test" / "000006", tmp_path / "single", "000006_")
    (tmp_path / "single" / "000006_000012.depth.png").unlink()
    (tmp_path / "single" / "000006_000000.mask_visib.json").write_text('{"0": {"size": [2, 2]}}')
    frames = BopFrames(tmp_path, "single", None)
    with pytest.raises(MissingFileError, match=r"000006_000012\.depth\.png"):
        frames.load("000006_000012")
    frame = frames.load("000006_000000")
    with pytest.raises(DataError, match=r"000006_000000\.mask_visib\.json, mask 0: counts is"):
        frames.visible_mask(frame, frame.targets[0])
    with pytest.raises(MissingFileError, match="no scene 7"):
        frames._scene("000007_000000")


def test_a_split_without_any_scene_is_an_error(tmp_path):
    (tmp_path / "test").mkdir()
    with pytest.raises(MissingFileError, match=r"no scene in .*test"):
        list_scenes(tmp_path / "test")
