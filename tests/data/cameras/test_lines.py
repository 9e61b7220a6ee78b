"""Images named by lines of JSON."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from hlp.data.cameras.camera import BrokenImage, LinesCamera
from hlp.data.own_frames import CameraSettings
from hlp.records import CameraImage

SETTINGS = CameraSettings(intrinsics=[500.0, 501.0, 20.0, 15.0])


@pytest.fixture
def named(tmp_path: Path) -> dict[str, str]:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((30, 40, 3), (10, 20, 30), np.uint8))
    cv2.imwrite(str(tmp_path / "a_depth.png"), np.full((30, 40), 900, np.uint16))
    return {"rgb": str(tmp_path / "a.png"), "depth": str(tmp_path / "a_depth.png")}


def test_each_line_is_an_image(named: dict[str, str]) -> None:
    more = named | {"name": "first", "captured": 12.5}
    lines = [json.dumps(more) + "\n", "\n", json.dumps(named)]
    first, second = LinesCamera(lines, SETTINGS)
    assert isinstance(first, CameraImage) and isinstance(second, CameraImage)
    assert (first.name, first.captured) == ("first", 12.5)
    assert (second.name, second.captured) == ("a", None)
    assert first.rgb[0, 0].tolist() == [30, 20, 10]
    np.testing.assert_allclose(first.depth, 0.9)
    np.testing.assert_array_equal(first.camera_matrix[:2, 2], [20.0, 15.0])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("rgb.png depth.png", "cannot read 'rgb.png depth.png'"),
        ('{"rgb": "a.png"}', 'a line must be {"rgb": FILE'),
        ("[1]", "a line must be"),
        ('{"rgb": "none.png", "depth": "none.png"}', "no image none.png"),
    ],
)
def test_a_wrong_line_costs_itself_alone(named: dict[str, str], line: str, words: str) -> None:
    broken, whole = LinesCamera([line, json.dumps(named)], SETTINGS)
    assert isinstance(broken, BrokenImage) and words in str(broken.error)
    assert isinstance(whole, CameraImage)


def test_a_wrong_time_is_named(named: dict[str, str]) -> None:
    (broken,) = LinesCamera([json.dumps(named | {"captured": "noon"})], SETTINGS)
    assert isinstance(broken, BrokenImage) and "captured is 'noon'" in str(broken.error)
