"""`hlp predict`: poses of learnt objects, or of one to be learnt, in a user's own frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from hlp.commands import composing, own_arguments
from hlp.errors import InputError

if TYPE_CHECKING:
    from hlp.data.own_frames import OwnFrames, SearchMasks
    from hlp.runs.prediction import PredictionOptions

_NEEDED = ("rgb", "depth", "intrinsics")
_OTHER = ("learnt", "model", "output", "work", "mask", "box", "threads")
_OPTIONS = ("objects", "max_instances", "min_score", "track", "panels")


def command(arguments: Sequence[str]) -> None:
    """Find the objects in every frame, after learning one unless that was done before."""
    if not arguments or composing.HELP & set(arguments):
        print(PREDICT_HELP)
        return
    own_arguments.call(lambda: _predict(arguments))


def continues(arguments: Sequence[str]) -> bool:
    """Whether the same call goes on where it was stopped; a sequence is tracked from its start."""
    named = any(each.startswith("output=") for each in arguments)
    return named and "track=true" not in arguments


def _predict(arguments: Sequence[str]) -> None:
    from hlp.data.frame_paths import with_frames
    from hlp.data.own_frames import FrameFiles, OwnFrames

    given = with_frames(own_arguments.split_arguments(arguments))
    either = [] if "learnt" in given or "model" in given else ["learnt", "model"]
    known = [*own_arguments.field_names(FrameFiles), *_OTHER, *_OPTIONS]
    own_arguments.check_mistyped(given, known, [*either, *_NEEDED], "predict")
    if ("learnt" in given) == ("model" in given):
        raise InputError("give learnt=FOLDER or model=FILE, see `hlp predict --help`")
    for key in _NEEDED:
        if key not in given:
            raise InputError(f"{key} is not set: give {key}=…, see `hlp predict --help`")
    if "learnt" in given:
        own_arguments.check_known(given, known, "predict")
    frames = OwnFrames(own_arguments.read_group(FrameFiles, given))
    masks, options = _masks(given), _options(given)
    output = own_arguments.output_folder(given, "predict")
    threads = own_arguments.whole_number(given, "threads")
    if (output / "learnt.json").exists():
        raise InputError(f"output={output} holds learnt objects: name another folder")
    folder = _learnt_folder(given, frames, known)

    from hlp.method.compute_threads import set_compute_threads
    from hlp.method.detector import Detector
    from hlp.runs.prediction import predict

    detector = Detector.load(folder, threads=threads)
    set_compute_threads(detector.threads)
    predict(detector, frames, output, options, masks)
    print(f"\nPoses     {output} (poses.csv in BOP's format, poses.jsonl, poses.json)")
    if (output / "panels").is_dir():
        print(f"Pictures  {output / 'panels'}")


def _learnt_folder(given: Mapping[str, str], frames: OwnFrames, known: Sequence[str]) -> Path:
    """The folder of the learnt objects; with `model` it is made, unless the cache has it."""
    from hlp.runs.learnt_cache import cache_folder, find_learnt

    cache = cache_folder(given.get("work"))
    if "learnt" in given:
        return find_learnt(given["learnt"], cache)
    from hlp.commands.learn import learning_request
    from hlp.runs.learning import learn_once

    request = learning_request(given, [str(Path(given["model"]).expanduser())], known)
    frames.load(frames.keys[0])  # what is wrong is said before minutes of learning
    return learn_once(cache, request)


def _options(given: Mapping[str, str]) -> PredictionOptions:
    from hlp.runs.prediction import PredictionOptions

    wanted = {key: given[key] for key in _OPTIONS if key in given}
    objects = own_arguments.names_of_objects(wanted)
    return own_arguments.read_group(PredictionOptions, wanted, objects=objects)


def _masks(given: Mapping[str, str]) -> SearchMasks | None:
    if "mask" not in given and "box" not in given:
        return None
    from hlp.data.own_frames import SearchMasks

    if "mask" in given and "box" in given:
        raise InputError("mask and box: give one of them")
    if "mask" in given:
        return SearchMasks(masks=str(own_arguments.plain_value(given["mask"])))
    box = own_arguments.plain_value(given["box"] if "[" in given["box"] else f"[{given['box']}]")
    if len(box) != 4 or not all(type(each) in (int, float) and abs(each) < 1e9 for each in box):
        raise InputError(f"box={given['box']}: it must be [x,y,width,height] in pixels")
    return SearchMasks(box=cast("tuple[float, float, float, float]", tuple(map(float, box))))


PREDICT_HELP = """\
usage: hlp predict learnt=FOLDER|NAME rgb=PATH depth=PATH intrinsics=FILE
                   [KEY=VALUE …]
       hlp predict model=FILE rgb=PATH depth=PATH intrinsics=FILE [KEY=VALUE …]

Poses of all instances of learnt objects in your own RGB-D frames.

  learnt       what `hlp learn` made: a folder, or a name in the user's cache
               (`hlp objects list`)
  model        or a mesh, which is learnt first (minutes) and kept in the cache
               for the next call; all keys of `hlp learn` can be given too

  rgb          a colour image, a folder, a pattern such as 'color_*.png', or a
               video
  depth        its depth image (16-bit PNG, TIFF, EXR, NPY), or a folder or
               pattern of them with the same names or numbers; registered to the
               colour
  frames       or a folder with rgb/, depth/ and cam_K.txt, camera.json or
               scene_camera.json
  intrinsics   JSON, YAML or text: cam_K or fx, fy, cx, cy; ROS's camera_info;
               RealSense; Open3D; OpenCV; nine numbers. Distortion is undone. Or
               [fx,fy,cx,cy] (px)

  depth_scale       millimetres per unit of the depth images (default: the
                    file's, else guessed)
  depth_intrinsics  the depth camera's, where depth has another size but stands
                    in the same place
  depth_resize      colour pixels per depth pixel, where depth is the same view
                    at another size
  undistort         false: the images are rectified though the intrinsics state
                    distortion

  objects        names of those to look for (default: all learnt ones)
  max_instances  of each object (default: 10)
  min_score      probability below which a pose is no answer (default: 0.5)
  track          true: the frames are a sequence; follow objects from frame to
                 frame
  mask, box      look only there: an image, or a folder with the names of the
                 frames; [x,y,w,h] (px)
  panels         number of frames that are drawn (default: 1 for one frame, 0
                 for several)
  output         folder of the results (default: outputs/predict/TIME)
  threads        of the computation (default: as when learning)
  work           folder in place of the user's cache

hlp predict learnt=learnt/ rgb=frame.png depth=frame_depth.png \\
    intrinsics=camera.json
hlp predict learnt=bracket rgb=rgb/ depth=depth/ \\
    "intrinsics=[572.4,573.6,325.3,242.0]"
hlp predict learnt=bracket frames=mustard0/
hlp predict model=bracket.ply rgb='color_*.png' depth='depth_*.png' \\
    intrinsics=camera_info.yaml

Written while frames are processed: poses.csv (BOP's format) and poses.jsonl (a
line for each answer, also for objects that were not found, and frames that
could not be used); at the end poses.json, and panels/ with pictures. R and t
(mm) map object coordinates to camera coordinates (x right, y down, z forward).
After a stop, the same call with output= continues, but for track=true."""
