"""`hlp predict` and `live`: poses of learnt objects in a user's own frames, or in a camera's."""

import json
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from hlp.commands import arguments as own
from hlp.data import cameras
from hlp.data.frame_paths import with_frames
from hlp.data.own_frames import CameraSettings, FrameFiles, OwnFrames
from hlp.errors import InputError
from hlp.files import expanded
from hlp.method.detector import Detector
from hlp.runs import live as answering
from hlp.runs import prediction
from hlp.runs.learnt_cache import cache_folder, find_learnt
from hlp.runs.prediction import PredictionOptions
from hlp.threads import set_compute_threads

_NEEDED = ("rgb", "depth", "intrinsics")
_OTHER = ("learnt", "model", "output", "work", "mask", "box", "threads")


def predict(arguments: Sequence[str]) -> None:
    """Find the objects in every frame, after learning one unless that was done before."""
    given = with_frames(own.split_arguments(arguments))
    known = [*own.field_names(FrameFiles, PredictionOptions), *_OTHER]
    if "learnt" in given and "model" in given:
        raise InputError("learnt and model: give one of them")
    own.need(given, ["learnt", *_NEEDED] if "model" not in given else _NEEDED, known, "predict")
    if "learnt" in given:  # with a model, further keys are those of learning
        own.check_known(given, known, "predict")
    frames = OwnFrames(own.read_group(FrameFiles, given))
    masks, objects = own.search_masks(given), own.names_of_objects(given)
    options = own.read_group(PredictionOptions, given, objects=objects)
    default = Path("outputs", "predict", time.strftime("%Y-%m-%d_%H-%M-%S"))
    output = expanded(given.get("output", default))
    if (output / "learnt.json").exists():
        raise InputError(f"output={output} holds learnt objects: name another folder")
    detector = _load(_learnt_folder(given, frames, known), given)
    prediction.predict(detector, frames, output, options, masks)
    print(f"\nPoses     {output} (poses.csv in BOP's format, poses.jsonl, poses.json)")
    if pictures := [*(output / "panels").glob("*.png")]:
        print(f"Pictures  {pictures[0] if len(pictures) == 1 else output / 'panels'}")


def _learnt_folder(given: Mapping[str, str], frames: OwnFrames, known: Sequence[str]) -> Path:
    """The folder of the learnt objects; with `model` it is made, unless the cache has it."""
    cache = cache_folder(given.get("work"))
    if "learnt" in given:
        return find_learnt(given["learnt"], cache)
    from hlp.commands.learn import learn_once, learning_request  # Hydra, torch: only to learn

    request = learning_request(given, [str(expanded(given["model"]))], known)
    frames.load(frames.keys[0])  # what is wrong is said before minutes of learning
    return learn_once(cache, request)


def _load(folder: Path, given: Mapping[str, str]) -> Detector:
    detector = Detector.load(folder, threads=own.whole_number(given, "threads"))
    set_compute_threads(detector.threads)
    return detector


_COMMON = ("source", "learnt", "overlay", "page", "threads", "work")
_SOURCES: dict[str, tuple[type, Callable[[Any], cameras.Camera]]] = {
    "folder": (cameras.FolderSettings, cameras.FolderCamera),
    "stdin": (CameraSettings, lambda settings: cameras.LinesCamera(_lines(), settings)),
    "realsense": (cameras.RealSenseSettings, cameras.RealSenseCamera),
}
"""The settings that a source takes as keys, and what makes a camera of them."""


def _lines() -> Iterable[str]:  # bytes of names that are not in UTF-8 stay as they are
    return open(0, encoding="utf-8", errors="surrogateescape", closefd=False)


def live(arguments: Sequence[str]) -> None:
    """Track objects in the images of a camera, and detect them where nothing is tracked."""
    given = own.split_arguments(arguments)
    own.need(given, ("source", "learnt"), _COMMON, "live")
    source = given["source"]
    if source not in _SOURCES and ".py:" not in source:
        raise InputError(
            f"source={source}: it must be {', '.join(_SOURCES)} or FILE.py:CLASS, "
            "see `hlp live --help`"
        )
    kinds = [_SOURCES[source][0]] if source in _SOURCES else []
    known = own.field_names(answering.LiveOptions, *kinds)
    own.check_known(given, sorted({*_COMMON, *known}), "live")
    options = own.read_group(answering.LiveOptions, given, objects=own.names_of_objects(given))
    detector = _load(find_learnt(given["learnt"], cache_folder(given.get("work"))), given)
    page = own.whole_number(given, "page", most=65535)
    overlay = expanded(given["overlay"]) if "overlay" in given else None
    with ExitStack() as stack:
        if source in _SOURCES:
            settings, make = _SOURCES[source]
            camera = make(own.read_group(settings, given))
        else:
            camera = cameras.load_camera(source)
        stack.callback(camera.close)
        pictures = None
        if overlay is not None or page is not None:
            pictures = answering.LivePictures(detector.models, overlay, page)
            stack.callback(pictures.close)
            if pictures.address is not None:
                print(f"Page  {pictures.address}", file=sys.stderr)
        answering.live(
            detector, camera, options, lambda line: print(json.dumps(line), flush=True), pictures
        )
