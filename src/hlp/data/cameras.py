"""Cameras for `hlp live`: sources of RGB-D images that come one after another.

A camera of a user's own, named lines, followed folders, or an Intel RealSense.
"""

import importlib
import json
import logging
import runpy
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np
from annotated_types import Le

from hlp.data.frame_paths import FramePaths, is_pattern, pairs_so_far
from hlp.data.own_frames import CameraSettings, FrameFiles, FrameReader
from hlp.errors import DataError, HlpError, InputError, MissingDependencyError, MissingFileError
from hlp.files import expanded
from hlp.records import CameraImage
from hlp.settings import Count, Doc, PositiveOrNone, Settings, shown

_FORM = 'a line must be {"rgb": FILE, "depth": FILE}, with "name" and "captured" as you like'
_LATEST = 1e12  # s since 1970; in ms they are more
_POLL = 0.01  # s between two looks into the folders
_PATIENCE = 1.0  # s: a file that cannot be read so long after it was first seen is broken
_ENDS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}
_TIMEOUT_MS = 5000  # of a RealSense's next images
_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class BrokenImage:
    """An image that could not be read: what it is called, and why."""

    name: str
    error: HlpError


@runtime_checkable
class Camera(Protocol):
    """Delivers images until it ends. A generator of `CameraImage` is one, too."""

    def __iter__(self) -> Iterator[CameraImage | BrokenImage]:
        """The images as they come; waits for the next one.

        An image that cannot be used may be left out or delivered as a `BrokenImage`.
        """

    def close(self) -> None:
        """Free the device, if one is open. Called once, also after an error or Ctrl-C."""
        return


def load_camera(source: str) -> Camera:
    """The camera that FILE.py:NAME makes: a class or a function without arguments.

    Raises MissingFileError and InputError naming what is wrong with `source`. The file is executed.
    """
    file, _, name = source.rpartition(":")
    path = expanded(file)
    if not path.is_file():
        raise MissingFileError(f"source={source}: there is no file {path} (give FILE.py:CLASS)")
    make = runpy.run_path(str(path)).get(name)
    if not callable(make):
        raise InputError(f"source={source}: {path} has no class or function {name}")
    camera = make()
    if not isinstance(camera, Camera):
        raise InputError(
            f"source={source}: what {name}() makes has no __iter__ or no close, see hlp live --help"
        )
    return camera


class LinesCamera(Camera):
    """Delivers the image of each line until the lines end.

    A line is a JSON object: `rgb` and `depth` are paths of files that are complete; `name` is what
    answers call the image (default: that of the colour file), `captured` when it was taken (s).
    """

    def __init__(self, lines: Iterable[str], settings: CameraSettings) -> None:
        self._lines, self._reader = lines, FrameReader(settings)
        _ = self._reader.camera  # what is wrong with the intrinsics is said before any line comes

    def __iter__(self) -> Iterator[CameraImage | BrokenImage]:
        """The images as they are named; see `Camera`."""
        for line in self._lines:
            if line.strip():
                yield self._read(line)

    def _read(self, line: str) -> CameraImage | BrokenImage:
        name = ""
        try:
            given = _parsed(line)
            name = str(given.get("name", Path(given["rgb"]).stem))
            rgb, depth = self._reader.read(FramePaths(Path(given["rgb"]), Path(given["depth"])))
        except HlpError as error:
            return BrokenImage(name, error)
        return CameraImage(rgb, depth, self._reader.camera.matrix, name, given.get("captured"))


def _parsed(line: str) -> dict[str, Any]:
    try:
        given = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(f"cannot read {line.strip()[:80]!r} ({error}): {_FORM}") from error
    if not isinstance(given, dict) or not all(
        isinstance(given.get(k), str) for k in ("rgb", "depth")
    ):
        raise InputError(f"cannot use {line.strip()[:80]!r}: {_FORM}")
    captured = given.get("captured")
    known = isinstance(captured, int | float) and abs(captured) < _LATEST
    if captured is not None and not known:
        raise InputError(f"captured is {shown(captured)}: it must be seconds since 1970")
    return given


@dataclass(frozen=True, kw_only=True)
class FolderSettings(FrameFiles):
    """Two folders or patterns, of colour and of depth images, that are followed."""

    idle_s: Annotated[
        PositiveOrNone, Doc("end after this time without a new image; null: never")
    ] = None
    newest: Annotated[
        bool, Doc("of several new images take the last one; false: each of them, in order")
    ] = False


class FolderCamera(Camera):
    """Delivers each pair of images once both are complete, in the order of their names.

    Images that are there at the beginning come first. A file that is not whole is waited for, for a
    second. Raises MissingFileError for a folder that does not exist.
    """

    def __init__(self, settings: FolderSettings) -> None:
        for key, given in (("rgb", settings.rgb), ("depth", settings.depth)):
            folder = Path(given).parent if is_pattern(given) else Path(given)
            if not folder.is_dir():
                raise MissingFileError(f"{key}={given}: there is no folder {folder} to follow")
        self._settings, self._reader = settings, FrameReader(settings)
        self._seen: set[Path] = set()
        self._waiting_since: dict[Path, float] = {}
        _ = self._reader.camera  # what is wrong with the intrinsics is said before any image comes

    def __iter__(self) -> Iterator[CameraImage | BrokenImage]:
        """The images as they come; see `Camera`."""
        last = time.monotonic()
        while True:
            image, idle = self._next(), self._settings.idle_s
            if image is not None:
                yield image
                last = time.monotonic()
            elif idle is not None and time.monotonic() - last >= idle:
                return
            else:
                time.sleep(_POLL)

    def _next(self) -> CameraImage | BrokenImage | None:
        pairs = pairs_so_far(self._settings.rgb, self._settings.depth)
        new = [pair for pair in pairs if pair.color not in self._seen]
        if not new:
            return None
        taken = new if self._settings.newest else new[:1]
        image = self._read(taken[-1])
        if image is not None:
            self._seen.update(pair.color for pair in taken)
        return image

    def _read(self, paths: FramePaths) -> CameraImage | BrokenImage | None:
        """The image, or None while it is being written."""
        begun = self._waiting_since.setdefault(paths.color, time.monotonic())
        patient = time.monotonic() - begun < _PATIENCE
        if patient and not (_is_whole(paths.color) and _is_whole(paths.depth)):
            return None
        try:
            rgb, depth = self._reader.read(paths)
            captured = paths.color.stat().st_mtime
        except HlpError as error:
            return None if patient else BrokenImage(paths.name, error)
        except FileNotFoundError:  # removed by now
            return None
        del self._waiting_since[paths.color]
        return CameraImage(rgb, depth, self._reader.camera.matrix, paths.name, captured)


def _is_whole(path: Path) -> bool:
    """Whether a file has its last bytes: OpenCV shows what there is of an image, and says nothing.

    True for kinds of files that have no mark at their end.
    """
    try:
        return path.read_bytes().endswith(_ENDS.get(path.suffix.lower(), b""))
    except OSError:
        return False


@dataclass(frozen=True, kw_only=True)
class RealSenseSettings(Settings):
    """Which RealSense camera, and its streams."""

    serial: Annotated[str | None, Doc("serial number; null: the first camera")] = None
    width: Annotated[Count, Le(8192), Doc("of both images (px)")] = 640
    height: Annotated[Count, Le(8192), Doc("of both images (px)")] = 480
    fps: Annotated[Count, Le(1000), Doc("images per second")] = 30


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
        if any(color.coeffs):
            said = "the camera states a distortion of its colour images, which is not undone: %s"
            _logger.warning(said, list(color.coeffs))
        x_row, y_row = [color.fx, 0.0, color.ppx], [0.0, color.fy, color.ppy]
        self._matrix = np.array([x_row, y_row, [0.0, 0.0, 1.0]])

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
