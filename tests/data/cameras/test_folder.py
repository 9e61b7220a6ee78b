"""A folder that another program fills."""

import json
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from hlp.data.cameras.camera import BrokenImage, FolderCamera, FolderSettings
from hlp.errors import DataError, MissingFileError
from hlp.records import CameraImage

CAMERA = [500.0, 501.0, 20.0, 15.0]


def encoded(number: int) -> tuple[bytes, bytes]:
    """A colour and a depth image (PNG) of a number."""
    rng = np.random.default_rng(number)
    color = rng.integers(0, 255, (30, 40, 3), dtype=np.uint8)
    depth = np.full((30, 40), 1000 + number, np.uint16)
    return tuple(cv2.imencode(".png", each)[1].tobytes() for each in (color, depth))  # type: ignore[return-value]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
    return tmp_path


def put(folder: Path, number: int) -> None:
    color, depth = encoded(number)
    (folder / "rgb" / f"{number}.png").write_bytes(color)
    (folder / "depth" / f"{number}.png").write_bytes(depth)


def camera(folder: Path, **more: object) -> FolderCamera:
    given = {"rgb": str(folder / "rgb"), "depth": str(folder / "depth"), "intrinsics": CAMERA}
    return FolderCamera(FolderSettings(**{"idle_s": 0.3} | given | more))  # type: ignore[arg-type]


def test_images_come_in_order_and_end_when_nothing_new_comes(folder: Path) -> None:
    for number in (10, 9, 2):
        put(folder, number)
    images = list(camera(folder))
    assert [each.name for each in images] == ["2", "9", "10"]
    first = images[0]
    assert isinstance(first, CameraImage)
    np.testing.assert_allclose(first.depth, 1.002)
    np.testing.assert_array_equal(first.rgb[..., ::-1], cv2.imread(str(folder / "rgb" / "2.png")))
    assert first.captured == pytest.approx(time.time(), abs=60)


def test_what_is_half_written_is_waited_for(folder: Path) -> None:
    """The colour file grows, then its depth image comes."""
    color, depth = encoded(1)
    path = folder / "rgb" / "1.png"
    path.write_bytes(color[: len(color) // 2])

    def finish() -> None:
        time.sleep(0.1)
        (folder / "depth" / "1.png").write_bytes(depth)
        time.sleep(0.1)
        path.write_bytes(color)

    writer = threading.Thread(target=finish)
    writer.start()
    (image,) = camera(folder, idle_s=0.5)
    writer.join()
    assert isinstance(image, CameraImage)
    np.testing.assert_array_equal(
        image.rgb[..., ::-1], cv2.imdecode(np.frombuffer(color, np.uint8), 1)
    )


def test_a_file_that_stays_broken_costs_its_own_image(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hlp.data.cameras.camera._PATIENCE", 0.05)
    put(folder, 1)
    put(folder, 2)
    (folder / "rgb" / "1.png").write_bytes(b"no image")
    broken, whole = camera(folder)
    assert isinstance(broken, BrokenImage) and isinstance(broken.error, DataError)
    assert broken.name == "1" and "1.png" in str(broken.error)
    assert whole.name == "2"


def test_of_several_new_images_the_newest_may_be_taken(folder: Path) -> None:
    for number in range(4):
        put(folder, number)
    images = iter(camera(folder, newest=True))
    assert next(images).name == "3"
    put(folder, 4)
    assert [each.name for each in images] == ["4"]


def test_numbers_pair_images_of_different_names(folder: Path) -> None:
    color, depth = encoded(7)
    (folder / "rgb" / "color_7.png").write_bytes(color)
    (folder / "depth" / "depth_7.png").write_bytes(depth)
    (folder / "rgb" / "color_8.png").write_bytes(color)  # its depth never comes
    assert [each.name for each in camera(folder)] == ["color_7"]


def test_what_is_missing_is_named_before_any_image(folder: Path) -> None:
    with pytest.raises(MissingFileError, match=r"rgb=.*nowhere: there is no folder"):
        camera(folder, rgb=str(folder / "nowhere"))
    with pytest.raises(MissingFileError, match=r"camera\.json"):
        camera(folder, intrinsics=str(folder / "camera.json"))
    (folder / "camera.json").write_text(json.dumps({"cam_K": [1, 2]}))
    with pytest.raises(ValueError, match=r"camera\.json"):
        camera(folder, intrinsics=str(folder / "camera.json"))
