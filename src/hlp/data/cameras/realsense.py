"""A RealSense camera, by Intel's pyrealsense2, which is imported when a camera is opened."""

import importlib
import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from hlp.errors import DataError, MissingDependencyError
from hlp.records import CameraImage
from hlp.settings import Doc, Settings

_TIMEOUT_MS = 5000
_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class RealSenseSettings(Settings):
    """Which RealSense camera, and its streams."""

    serial: Annotated[str | None, Doc("serial number; null: the first camera")] = None
    width: Annotated[int, Ge(1), Le(8192), Doc("of both images (px)")] = 640
    height: Annotated[int, Ge(1), Le(8192), Doc("of both images (px)")] = 480
    fps: Annotated[int, Ge(1), Le(1000), Doc("images per second")] = 30


class RealSenseCamera:
    """Delivers colour with depth aligned to it. Of images that came meanwhile, the last.

    Raises MissingDependencyError without pyrealsense2, DataError without a camera.
    """

    def __init__(self, settings: RealSenseSettings) -> None:
        try:
            rs = importlib.import_module("pyrealsense2")
        except ImportError as error:
            raise MissingDependencyError(
                "source=realsense needs the package pyrealsense2: pip install 'hlp[realsense]'"
            ) from error
        self._pipeline, config = rs.pipeline(), rs.config()
        if settings.serial is not None:
            config.enable_device(settings.serial)
        size = settings.width, settings.height
        config.enable_stream(rs.stream.color, *size, rs.format.rgb8, settings.fps)
        config.enable_stream(rs.stream.depth, *size, rs.format.z16, settings.fps)
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise DataError(
                f"no RealSense camera can be started ({error}): check the cable, serial, width, "
                "height and fps"
            ) from error
        self._align = rs.align(rs.stream.color)
        self._metres = float(profile.get_device().first_depth_sensor().get_depth_scale())
        color = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
        self._matrix = _matrix(color)

    def __iter__(self) -> Iterator[CameraImage]:
        """The images as they come; see `Camera`. Raises DataError if none comes for 5 s."""
        number = 0
        while True:
            try:
                frames = self._align.process(self._pipeline.wait_for_frames(_TIMEOUT_MS))
            except RuntimeError as error:
                raise DataError(f"the RealSense camera delivers no images: {error}") from error
            color, depth = frames.get_color_frame(), frames.get_depth_frame()
            if not color or not depth:
                continue
            rgb = np.array(color.get_data(), dtype=np.uint8)  # copies: the buffers are used again
            metres = np.asarray(depth.get_data()).astype(np.float32) * np.float32(self._metres)
            yield CameraImage(rgb, metres, self._matrix, f"{number:06d}", time.time())
            number += 1

    def close(self) -> None:
        """Stop the streams."""
        self._pipeline.stop()


def _matrix(intrinsics: Any) -> np.ndarray[Any, Any]:
    if any(intrinsics.coeffs):
        _logger.warning(
            "the camera states a distortion of its colour images, which is not undone: %s",
            list(intrinsics.coeffs),
        )
    fx, fy, cx, cy = intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
