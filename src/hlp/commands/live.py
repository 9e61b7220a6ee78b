"""`hlp live`: poses of learnt objects in the images of a camera, as they come."""

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from hlp.commands import arguments as own
from hlp.data.cameras import (
    Camera,
    FolderCamera,
    FolderSettings,
    LinesCamera,
    RealSenseCamera,
    RealSenseSettings,
    load_camera,
)
from hlp.data.own_frames import CameraSettings
from hlp.errors import InputError
from hlp.kernels import set_compute_threads
from hlp.method.detector import Detector
from hlp.runs import live as answering
from hlp.runs.learnt_cache import cache_folder, find_learnt
from hlp.runs.live import Line, LiveOptions, LivePictures

_COMMON = ("source", "learnt", "overlay", "page", "threads", "work")
_SOURCES: dict[str, tuple[type, Callable[[Any], Camera]]] = {
    "folder": (FolderSettings, FolderCamera),
    "stdin": (CameraSettings, lambda settings: LinesCamera(_lines(), settings)),
    "realsense": (RealSenseSettings, RealSenseCamera),
}
"""The settings that a source takes as keys, and what makes a camera of them."""


def _lines() -> Iterable[str]:  # bytes of names that are not in UTF-8 stay as they are
    return open(0, encoding="utf-8", errors="surrogateescape", closefd=False)


def live(arguments: Sequence[str]) -> None:
    """Track objects in the images of a camera, and detect them where nothing is tracked."""
    given = own.split_arguments(arguments)
    options = _options(given)
    folder = find_learnt(given["learnt"], cache_folder(given.get("work")))
    detector = Detector.load(folder, threads=own.whole_number(given, "threads"))
    set_compute_threads(detector.threads)
    page = own.whole_number(given, "page", most=65535)
    overlay = own.path_of(given, "overlay", "") if "overlay" in given else None
    with ExitStack() as stack:
        camera = _camera(given)
        stack.callback(camera.close)
        pictures = None
        if overlay is not None or page is not None:
            pictures = LivePictures(detector.models, overlay, page)
            stack.callback(pictures.close)
            if pictures.address is not None:
                print(f"Page  {pictures.address}", file=sys.stderr)
        answering.live(detector, camera, options, _print_line, pictures)


def _options(given: Mapping[str, str]) -> LiveOptions:
    """How to answer. Raises InputError for a key that is missing, or that the source lacks."""
    own.need(given, ("source", "learnt"), _COMMON, "live")
    source, keys = given["source"], own.field_names(LiveOptions)
    if source not in _SOURCES and ".py:" not in source:
        raise InputError(
            f"source={source}: it must be {', '.join(_SOURCES)} or FILE.py:CLASS, "
            "see `hlp live --help`"
        )
    of_camera = own.field_names(_SOURCES[source][0]) if source in _SOURCES else ()
    own.check_known(given, sorted({*_COMMON, *keys, *of_camera}), "live")
    return own.read_group(LiveOptions, given, objects=own.names_of_objects(given))


def _camera(given: Mapping[str, str]) -> Camera:
    if given["source"] not in _SOURCES:
        return load_camera(given["source"])
    settings, camera = _SOURCES[given["source"]]
    return camera(own.read_group(settings, given))


def _print_line(line: Line) -> None:
    print(json.dumps(line), flush=True)
