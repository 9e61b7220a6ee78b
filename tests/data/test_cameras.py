"""Cameras of `hlp live`: followed folders, named lines, a user's own."""

import itertools
import json
import threading
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hlp.data.cameras import BrokenImage, FolderCamera, FolderSettings, LinesCamera, load_camera
from hlp.data.frame_paths import FramePaths
from hlp.data.own_frames import CameraSettings
from hlp.errors import DataError, InputError, MissingFileError
from hlp.records import CameraImage

CAMERA = [500.0, 501.0, 20.0, 15.0]


def encoded(number: int) -> tuple[bytes, bytes]:
    """A colour and a depth image (PNG) of a number."""
    color = np.random.default_rng(number).integers(0, 255, (30, 40, 3), dtype=np.uint8)
    depth = np.full((30, 40), 1000 + number, np.uint16)
    return tuple(cv2.imencode(".png", image)[1].tobytes() for image in (color, depth))  # type: ignore[return-value]


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
    assert [image.name for image in images] == ["2", "9", "10"]
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
    monkeypatch.setattr("hlp.data.cameras._PATIENCE", 0.05)
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
    assert [image.name for image in images] == ["4"]


def test_numbers_pair_images_of_different_names(folder: Path) -> None:
    color, depth = encoded(7)
    (folder / "rgb" / "color_7.png").write_bytes(color)
    (folder / "depth" / "depth_7.png").write_bytes(depth)
    (folder / "rgb" / "color_8.png").write_bytes(color)  # its depth never comes
    assert [image.name for image in camera(folder)] == ["color_7"]


def test_what_is_missing_is_named_before_any_image(folder: Path) -> None:
    with pytest.raises(MissingFileError, match=r"rgb=.*nowhere: there is no folder"):
        camera(folder, rgb=str(folder / "nowhere"))
    with pytest.raises(MissingFileError, match=r"camera\.json"):
        camera(folder, intrinsics=str(folder / "camera.json"))


SETTINGS = CameraSettings(intrinsics=[500.0, 501.0, 20.0, 15.0])


@pytest.fixture
def named(tmp_path: Path) -> dict[str, str]:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((30, 40, 3), (10, 20, 30), np.uint8))
    cv2.imwrite(str(tmp_path / "a_depth.png"), np.full((30, 40), 900, np.uint16))
    return {"rgb": str(tmp_path / "a.png"), "depth": str(tmp_path / "a_depth.png")}


def test_each_line_is_an_image(named: dict[str, str]) -> None:
    more = named | {"name": "first", "captured": 12.5}
    first, second = LinesCamera([json.dumps(more) + "\n", "\n", json.dumps(named)], SETTINGS)
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
        ('{"rgb": "%s.png", "depth": "a"}' % ("n" * 5000), "File name too long"),
        ('{"rgb": "a\\u0000", "depth": "a"}', "no image a"),
        ("[" * 100_000, "cannot read '[[["),
        ('{"rgb": "\udcff", "depth": "a"}', "no image"),  # bytes that are not UTF-8
    ],
)
def test_a_wrong_line_costs_itself_alone(named: dict[str, str], line: str, words: str) -> None:
    broken, whole = LinesCamera([line, json.dumps(named)], SETTINGS)
    assert isinstance(broken, BrokenImage) and words in str(broken.error)
    assert isinstance(whole, CameraImage)


@pytest.mark.parametrize("time", ['"noon"', "NaN", "-1e999", "1e13", "[]"])
def test_a_wrong_time_is_named(named: dict[str, str], time: str) -> None:
    (broken,) = LinesCamera([json.dumps(named)[:-1] + f', "captured": {time}}}'], SETTINGS)
    assert isinstance(broken, BrokenImage) and "must be seconds since 1970" in str(broken.error)


def test_a_file_that_may_not_be_read_costs_its_own_image(
    named: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    read = Path.read_bytes

    def refused(path: Path) -> bytes:
        if path.stem == "closed":
            raise PermissionError(13, "Permission denied", str(path))
        return read(path)

    for name, key in itertools.product(("closed.png", "closed.npy"), ("rgb", "depth")):
        closed = Path(named["rgb"]).with_name(name)
        closed.touch()
        monkeypatch.setattr(Path, "read_bytes", refused)
        lines = [json.dumps(named | {key: str(closed)}), json.dumps(named)]
        broken, whole = LinesCamera(lines, SETTINGS)
        assert isinstance(broken, BrokenImage) and isinstance(whole, CameraImage)
        assert str(broken.error) == f"{closed} cannot be read: Permission denied"


def test_an_image_that_is_removed_while_it_is_read_ends_nothing(folder: Path) -> None:
    put(folder, 1)
    put(folder, 2)
    followed = camera(folder)
    read = followed._reader.read

    def read_and_remove(paths: FramePaths) -> Any:
        found = read(paths)
        if paths.name == "1":
            paths.color.unlink()
        return found

    followed._reader.read = read_and_remove  # type: ignore[method-assign]
    assert [image.name for image in followed] == ["2"]


OWN = """
import numpy as np
from hlp import CameraImage

class Mine:
    def __iter__(self):
        yield CameraImage(np.zeros((4, 6, 3), np.uint8), np.ones((4, 6)), np.eye(3), "one")
    def close(self):
        self.closed = True

def frames():
    yield from Mine()

class NoCamera:
    pass
"""


def test_a_class_or_a_generator_is_a_camera(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(OWN)
    for name in ("Mine", "frames"):
        camera = load_camera(f"{path}:{name}")
        assert [image.name for image in camera] == ["one"]
        camera.close()


def test_what_is_no_camera_is_named(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(OWN)
    for name, words in (("Other", "no class or function Other"), ("NoCamera", "no __iter__")):
        with pytest.raises(InputError, match=words):
            load_camera(f"{path}:{name}")
    with pytest.raises(MissingFileError, match=r"there is no file .*none\.py"):
        load_camera(f"{tmp_path / 'none.py'}:Mine")
