"""Images that another program names, a line of JSON for each."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from hlp.data.cameras.camera import BrokenImage
from hlp.data.frame_paths import FramePaths
from hlp.data.own_frames import CameraSettings, FrameReader
from hlp.errors import HlpError, InputError
from hlp.records import CameraImage

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
