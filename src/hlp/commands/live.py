"""`hlp live`: poses of learnt objects in the images of a camera, as they come."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.commands import composing, own_arguments
from hlp.commands.ending import INTERRUPTED, TERMINATED, TerminatedError
from hlp.errors import InputError

if TYPE_CHECKING:
    from hlp.data.cameras import Camera
    from hlp.runs.live import Line

_COMMON = ("source", "learnt", "overlay", "page", "threads", "work")


def command(arguments: Sequence[str]) -> None:
    """Track objects in the images of a camera, and detect them where nothing is tracked."""
    if not arguments or composing.HELP & set(arguments):
        print(LIVE_HELP)
        return
    own_arguments.call(lambda: _live(arguments), messages=sys.stderr)


def _live(arguments: Sequence[str]) -> None:
    given = own_arguments.split_arguments(arguments)
    for key in ("source", "learnt"):
        if key not in given:
            raise InputError(f"{key} is not set: give {key}=…, see `hlp live --help`")
    from hlp.runs.learnt_cache import cache_folder, find_learnt
    from hlp.runs.live import LiveOptions, LivePictures, live

    settings = _settings_of(given["source"])
    options = own_arguments.field_names(LiveOptions)
    known = sorted({*_COMMON, *options, *own_arguments.field_names(*settings)})
    own_arguments.check_known(given, known, "live")
    wanted = {key: given[key] for key in options if key in given}
    objects = own_arguments.names_of_objects(wanted)
    chosen = own_arguments.read_group(LiveOptions, wanted, objects=objects)
    folder = find_learnt(given["learnt"], cache_folder(given.get("work")))

    from hlp.method.compute_threads import set_compute_threads
    from hlp.method.detector import Detector

    detector = Detector.load(folder, threads=own_arguments.whole_number(given, "threads"))
    set_compute_threads(detector.threads)
    overlay, page = given.get("overlay"), own_arguments.whole_number(given, "page", most=65535)
    camera = _camera(given, settings)
    pictures, answers = None, _Answers()
    try:
        if overlay is not None or page is not None:
            file = None if overlay is None else Path(overlay).expanduser()
            pictures = LivePictures(detector.models, file, page)
            if pictures.address is not None:
                print(f"Page  {pictures.address}", file=sys.stderr)
        live(detector, camera, chosen, answers, pictures)
    except KeyboardInterrupt as error:
        terminated = isinstance(error, TerminatedError)
        print(f"hlp: stopped after {answers.images} images", file=sys.stderr)
        sys.exit(TERMINATED if terminated else INTERRUPTED)
    except BrokenPipeError:  # the reader of the answers has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        camera.close()
        if pictures is not None:
            pictures.close()


class _Answers:
    """Writes each line at once, and counts the images."""

    def __init__(self) -> None:
        self.images = 0

    def __call__(self, line: Line) -> None:
        print(json.dumps(line), flush=True)
        self.images += "image" in line


def _settings_of(source: str) -> tuple[type, ...]:
    """The settings that a source takes as keys."""
    from hlp.data.cameras import FolderSettings, RealSenseSettings
    from hlp.data.own_frames import CameraSettings

    known: dict[str, tuple[type, ...]] = {
        "folder": (FolderSettings,),
        "stdin": (CameraSettings,),
        "realsense": (RealSenseSettings,),
    }
    if source not in known and ".py:" not in source:
        raise InputError(
            f"source={source}: it must be {', '.join(known)} or FILE.py:CLASS, "
            "see `hlp live --help`"
        )
    return known.get(source, ())


def _camera(given: Mapping[str, str], settings: tuple[type, ...]) -> Camera:
    from hlp.data.cameras import FolderCamera, LinesCamera, RealSenseCamera, load_camera

    if not settings:
        return load_camera(given["source"])
    read: Any = own_arguments.read_group(settings[0], given)
    if given["source"] == "folder":
        return FolderCamera(read)
    if given["source"] == "stdin":
        return LinesCamera(sys.stdin, read)
    return RealSenseCamera(read)


LIVE_HELP = """\
usage: hlp live source=folder|stdin|realsense|FILE.py:CLASS
                learnt=FOLDER|NAME [KEY=VALUE …]

Answers each image of a camera as it comes: objects are tracked from image to
image, and detected where nothing is tracked. Each answer is a line of JSON on
standard output; the first line says that everything is loaded. Messages go to
standard error. Ctrl-C ends it.

  source       folder: follows two folders that another program fills
               stdin: a line {"rgb": FILE, "depth": FILE} for each image
               realsense: an Intel RealSense (pip install 'hlp[realsense]')
               FILE.py:CLASS: a camera of your own
  learnt       what `hlp learn` made: a folder, or a name in the user's cache

folder and stdin (all keys of `hlp predict` that describe images):
  intrinsics   of the colour camera: a file, or [fx,fy,cx,cy] (px)
  depth_scale  millimetres per unit of the depth images; also depth_intrinsics,
               depth_resize, undistort
folder:
  rgb, depth   folders or patterns; images of one name, or one number, belong
               together
  idle_s       end after so many seconds without a new image (default: never)
  newest       true: of several new images answer the last one only
realsense:
  serial, width, height, fps    which camera, and its streams (default: the
                                first, 640 × 480, 30)

  objects        names of those to look for (default: all learnt ones)
  max_instances  of each object (default: 1)
  min_score      probability below which a tracked object is detected again, and
                 a pose is no answer (default: 0.5)
  search_every   images between searches for further instances (default: 30; 0:
                 none)
  prediction     false: do not expect objects to move on as before
  overlay        a .png or .jpg file that is replaced by each image with its
                 poses
  page           port of a page on this machine that shows the same, e.g.
                 page=8000
  threads        of the computation (default: as when learning)
  work           folder in place of the user's cache

hlp live source=folder learnt=learnt/ rgb=rgb/ depth=depth/ \\
    intrinsics=camera.json page=8000
hlp live source=realsense learnt=bracket overlay=last.jpg | python robot.py

docs/live.md describes the fields of the answers, and how to write a camera."""
