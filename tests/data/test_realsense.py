"""A RealSense as a camera of `hlp live`, by a stand-in for its library."""

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hlp.data.cameras import RealSenseCamera, RealSenseSettings
from hlp.errors import DataError, MissingDependencyError

COLOR = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
DEPTH = np.full((4, 6), 2500, np.uint16)


class Pipeline:
    fails_to_start = False

    def __init__(self) -> None:
        self.left, self.stopped = 2, False

    def start(self, config: Any) -> Any:
        if self.fails_to_start:
            raise RuntimeError("No device connected")
        color = SimpleNamespace(fx=600.0, fy=601.0, ppx=3.0, ppy=2.0, coeffs=[0.0] * 5)
        stream = SimpleNamespace(get_intrinsics=lambda: color)
        sensor = SimpleNamespace(get_depth_scale=lambda: 0.0005)
        device = SimpleNamespace(first_depth_sensor=lambda: sensor)
        return SimpleNamespace(
            get_device=lambda: device,
            get_stream=lambda kind: SimpleNamespace(as_video_stream_profile=lambda: stream),
        )

    def wait_for_frames(self, timeout: int) -> Any:
        if self.left == 0:
            raise RuntimeError(f"Frame didn't arrive within {timeout}")
        self.left -= 1
        return SimpleNamespace(
            get_color_frame=lambda: SimpleNamespace(get_data=lambda: COLOR),
            get_depth_frame=lambda: SimpleNamespace(get_data=lambda: DEPTH),
        )

    def stop(self) -> None:
        self.stopped = True


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the configuration is asked for."""
    calls: list[Any] = []
    config = SimpleNamespace(
        enable_device=lambda serial: calls.append(serial),
        enable_stream=lambda *given: calls.append(given),
    )
    module = SimpleNamespace(
        pipeline=Pipeline,
        config=lambda: config,
        align=lambda stream: SimpleNamespace(process=lambda frames: frames),
        stream=SimpleNamespace(color="color", depth="depth"),
        format=SimpleNamespace(rgb8="rgb8", z16="z16"),
    )
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return calls


def test_images_are_aligned_and_in_metres(asked: list[Any]) -> None:
    camera = RealSenseCamera(RealSenseSettings(serial="123", width=6, height=4, fps=15))
    assert asked == ["123", ("color", 6, 4, "rgb8", 15), ("depth", 6, 4, "z16", 15)]
    images = iter(camera)
    image = next(images)
    np.testing.assert_array_equal(image.rgb, COLOR)
    assert not np.shares_memory(image.rgb, COLOR)
    np.testing.assert_allclose(image.depth, 1.25)
    np.testing.assert_array_equal(image.camera_matrix, [[600, 0, 3], [0, 601, 2], [0, 0, 1]])
    assert [image.name, next(images).name] == ["000000", "000001"]
    with pytest.raises(DataError, match="delivers no images"):
        next(images)
    camera.close()
    assert camera._pipeline.stopped


def test_what_is_missing_is_said(asked: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pipeline, "fails_to_start", True)
    with pytest.raises(DataError, match="No device connected"):
        RealSenseCamera(RealSenseSettings())
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)  # importing it raises ImportError
    with pytest.raises(MissingDependencyError, match=r"pip install 'hlp\[realsense\]'"):
        RealSenseCamera(RealSenseSettings())
