"""Interface of the cameras, and how one in a user's own file is found."""

import importlib.util
import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

from annotated_types import Gt

from hlp.data.frame_paths import FramePaths, is_pattern, pairs_so_far
from hlp.data.own_frames import CameraSettings, FrameFiles, FrameReader
from hlp.errors import HlpError, InputError, MissingFileError
from hlp.records import CameraImage
from hlp.settings import Doc


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
        ...

    def close(self) -> None:
        """Free the device. Called once, also after an error or Ctrl-C."""
        ...


def load_camera(source: str) -> Camera:
    """The camera that FILE.py:NAME makes: a class or a function without arguments.

    Raises MissingFileError and InputError naming what is wrong with `source`. The file is executed.
    """
    file, _, name = source.rpartition(":")
    path = Path(file).expanduser()
    if not path.is_file():
        raise MissingFileError(f"source={source}: there is no file {path} (give FILE.py:CLASS)")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise InputError(f"source={source}: {path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    make: Any = getattr(module, name, None)
    if not callable(make):
        raise InputError(f"source={source}: {path} has no class or function {name}")
    camera = make()
    if not isinstance(camera, Camera):
        raise InputError(
            f"source={source}: what {name}() makes has no __iter__ or no close, see hlp live --help"
        )
    return camera


_FILES = ("rgb", "depth")
_FORM = 'a line must be {"rgb": FILE, "depth": FILE}, with "name" and "captured" as you like'


class LinesCamera:
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

    def close(self) -> None:
        """The lines belong to the caller."""

    def _read(self, line: str) -> CameraImage | BrokenImage:
        name = ""
        try:
            given = _parsed(line)
            name = str(given.get("name", Path(given["rgb"]).stem))
            rgb, depth = self._reader.read(FramePaths(Path(given["rgb"]), Path(given["depth"])))
        except HlpError as error:
            return BrokenImage(name, error)
        captured = given.get("captured")
        return CameraImage(rgb, depth, self._reader.camera.matrix, name, captured)


def _parsed(line: str) -> dict[str, Any]:
    try:
        given = json.loads(line)
    except ValueError as error:
        raise InputError(f"cannot read {line.strip()[:80]!r} ({error}): {_FORM}") from error
    if not isinstance(given, dict) or not all(isinstance(given.get(k), str) for k in _FILES):
        raise InputError(f"cannot use {line.strip()[:80]!r}: {_FORM}")
    if not isinstance(given.get("captured"), int | float | None):
        raise InputError(f"captured is {given['captured']!r}: it must be seconds since 1970")
    return given


_POLL = 0.01  # s between two looks into the folders
_PATIENCE = 1.0  # s: a file that cannot be read so long after it was first seen is broken
_ENDS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}


@dataclass(frozen=True, kw_only=True)
class FolderSettings(FrameFiles):
    """Two folders or patterns, of colour and of depth images, that are followed."""

    idle_s: Annotated[
        float | None, Gt(0), Doc("end after this time without a new image; null: never")
    ] = None
    newest: Annotated[
        bool, Doc("of several new images take the last one; false: each of them, in order")
    ] = False


class FolderCamera:
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
            image = self._next()
            if image is not None:
                yield image
                last = time.monotonic()
            elif (
                self._settings.idle_s is not None
                and time.monotonic() - last >= self._settings.idle_s
            ):
                return
            else:
                time.sleep(_POLL)

    def close(self) -> None:
        """Nothing is open."""

    def _next(self) -> CameraImage | BrokenImage | None:
        pairs = pairs_so_far(self._settings.rgb, self._settings.depth)
        new = [each for each in pairs if each.color not in self._seen]
        if not new:
            return None
        paths = new[-1] if self._settings.newest else new[0]
        image = self._read(paths)
        if image is not None:
            skipped = new if self._settings.newest else [paths]
            self._seen.update(each.color for each in skipped)
        return image

    def _read(self, paths: FramePaths) -> CameraImage | BrokenImage | None:
        """The image, or None while it is being written."""
        begun = self._waiting_since.setdefault(paths.color, time.monotonic())
        patient = time.monotonic() - begun < _PATIENCE
        if patient and not (_is_whole(paths.color) and _is_whole(paths.depth)):
            return None
        try:
            rgb, depth = self._reader.read(paths)
        except HlpError as error:
            return None if patient else BrokenImage(paths.name, error)
        del self._waiting_since[paths.color]
        captured = paths.color.stat().st_mtime
        return CameraImage(rgb, depth, self._reader.camera.matrix, paths.name, captured)


def _is_whole(path: Path) -> bool:
    """Whether a file has its last bytes: OpenCV shows what there is of an image, and says nothing.

    True for kinds of files that have no mark at their end.
    """
    end = _ENDS.get(path.suffix.lower(), b"")
    try:
        with path.open("rb") as stream:
            stream.seek(0, 2)
            stream.seek(max(stream.tell() - len(end), 0))
            return stream.read() == end if end else True
    except OSError:
        return False
