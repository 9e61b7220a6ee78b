"""`hlp predict`: poses of learnt objects, or of one to be learnt, in a user's own frames."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from hlp.commands import arguments as own
from hlp.data.frame_paths import with_frames
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.errors import InputError
from hlp.files import expanded
from hlp.kernels import set_compute_threads
from hlp.method.detector import Detector
from hlp.runs import prediction
from hlp.runs.learnt_cache import cache_folder, find_learnt
from hlp.runs.prediction import PredictionOptions

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
    output = own.path_of(given, "output", default)
    threads = own.whole_number(given, "threads")
    if (output / "learnt.json").exists():
        raise InputError(f"output={output} holds learnt objects: name another folder")
    folder = _learnt_folder(given, frames, known)
    detector = Detector.load(folder, threads=threads)
    set_compute_threads(detector.threads)
    prediction.predict(detector, frames, output, options, masks)
    print(f"\nPoses     {output} (poses.csv in BOP's format, poses.jsonl, poses.json)")
    if (output / "panels").is_dir():
        print(f"Pictures  {output / 'panels'}")


def _learnt_folder(given: Mapping[str, str], frames: OwnFrames, known: Sequence[str]) -> Path:
    """The folder of the learnt objects; with `model` it is made, unless the cache has it."""
    cache = cache_folder(given.get("work"))
    if "learnt" in given:
        return find_learnt(given["learnt"], cache)
    from hlp.commands.learn import learn_once, learning_request  # Hydra, torch: only to learn

    request = learning_request(given, [str(expanded(given["model"]))], known)
    frames.load(frames.keys[0])  # what is wrong is said before minutes of learning
    return learn_once(cache, request)
