"""`hlp doctor`: what is wrong with a data set, frames, learnt objects or this machine."""

import os
import re
import shutil
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path

from hlp.arrays import Mask
from hlp.checks import Finding
from hlp.checks.frame_checks import check_frames, check_object_size, read_frames
from hlp.checks.known_objects import ABSENT, check_with_objects
from hlp.checks.true_poses import check_true_colors, check_true_poses
from hlp.commands import arguments as own
from hlp.commands.ending import EVERYTHING
from hlp.data.bop import BopFrames, BopSettings
from hlp.data.frame_paths import with_frames
from hlp.data.own_frames import FrameFiles, OwnFrames, SearchMasks
from hlp.errors import HlpError
from hlp.files import expanded
from hlp.kernels import extension
from hlp.method.detector import Detector
from hlp.reporting.figures.panels import draw_detections, write_picture
from hlp.runs.learnt_cache import cache_folder, find_learnt

_LEAST_DISK = 2.0e9  # bytes that learning an object takes for a while


def check_libraries(requirements: Sequence[str] | None = None) -> list[Finding]:
    """Required libraries that are missing; by default those of the installed package.

    Without torch, what learning needs was left out on purpose, which is one finding.
    """
    missing = {}
    for requirement in (requires("hlp") if requirements is None else requirements) or ():
        if "extra ==" in requirement:
            continue
        name = re.split(r"[\s<>=!~;\[(]", requirement)[0]
        try:
            version(name)
        except PackageNotFoundError:
            missing[name] = f"pip install '{requirement}'"
    if "torch" in missing:
        problem = "torch is not installed: objects are found, but none can be learnt"
        return [Finding("libraries", "torch", problem, EVERYTHING)]
    return [Finding("libraries", name, "it is not installed", missing[name]) for name in missing]


def check_threads() -> list[Finding]:
    """Variables that make libraries spin, or use more threads than there are cores."""
    found = []
    if os.environ.get("OMP_WAIT_POLICY", "PASSIVE").upper() == "ACTIVE":
        problem = "idle threads keep their cores busy, which can cost a factor of twenty"
        found.append(Finding("threads", "OMP_WAIT_POLICY=ACTIVE", problem, "Set it to PASSIVE"))
    usable = os.cpu_count() or 1
    for key in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        text = os.environ.get(key, "")
        if text.isdecimal() and int(text) > usable:
            problem, advice = f"this machine has {usable} cores", f"Set it to {usable} or less"
            found.append(Finding("threads", f"{key}={text}", problem, advice))
    return found


def check_disk(folder: Path) -> list[Finding]:
    """Too little room where what is learnt is kept."""
    place = next(path for path in (folder, *folder.parents) if path.exists())
    left = shutil.disk_usage(place).free
    if left >= _LEAST_DISK:
        return []
    problem = f"{left / 1e9:.1f} GB are free; learning an object takes up to {_LEAST_DISK / 1e9:g}"
    advice = "Free some, or choose another folder with work=FOLDER"
    return [Finding("disk", str(folder), problem, advice)]


_KEPT = 6  # frames whose content is looked at
_LAYOUT = (
    "The folder must be in BOP's layout: models/obj_000001.ply …, and for each scene "
    "test/000001/rgb/, depth/, scene_camera.json and scene_gt.json"
)


def examine_learnt(folder: Path) -> tuple[Detector | None, list[Finding]]:
    """Learnt objects, all loaded; None if they cannot be."""
    try:
        detector = Detector.load(folder)
        detector.warm_up()
        return detector, check_object_size(list(detector.models.values()))
    except HlpError as error:
        return None, [Finding("learnt objects", str(folder), str(error), "Learn them again")]


def examine_dataset(root: Path, output: Path | None) -> list[Finding]:
    """A data set in BOP's layout: files, cameras, and whether poses fit the depth images.

    With `output` some frames are drawn there with the objects at their true poses.
    """
    try:
        dataset = BopSettings(name="bop", root=str(root)).build()
        source, keys = dataset.frames, dataset.frames.keys
    except HlpError as error:
        return [Finding("data set", str(root), str(error), _LAYOUT)]
    read = source.read if isinstance(source, BopFrames) else None
    frames, findings = read_frames(source.load, keys, _KEPT, read)
    causes = check_frames(frames, list(dataset.models.values()))
    causes = causes or check_true_poses(frames, dataset.models)
    causes += check_true_colors(frames, dataset.models)
    if output is not None:
        for frame in frames:
            known = [target for target in frame.targets if target.object_id in dataset.models]
            poses = [(dataset.models[target.object_id], target.pose_cam_obj) for target in known]
            write_picture(output / f"truth_{frame.key}.png", draw_detections(frame, poses))
    # Values that make no sense have a cause; where it is known, only the cause is said.
    return [found for found in findings if not causes or found.kind != "values"] + causes


def examine_own(
    frames: OwnFrames, detector: Detector | None, masks: SearchMasks | None = None
) -> list[Finding]:
    """A user's own frames, with learnt objects to look for or without."""
    try:
        _ = frames.keys, frames.camera
    except HlpError as error:
        return [Finding("files", "frames", str(error), "Correct it and call again")]
    read, findings = read_frames(frames.load, frames.keys, _KEPT)
    findings += check_frames(read, [] if detector is None else list(detector.models.values()))
    if detector is None or not read:
        return findings
    marked = dict[str, Mask]()
    if masks is not None:
        shapes = {frame.key: frame.depth.shape for frame in read}
        marked = {key: masks.load(frames.paths(key), shape) for key, shape in shapes.items()}
    causes = check_with_objects(detector, read, marked, frames.depth_scale)
    # What is found out with objects says more than what frames alone do, and names it once.
    return causes if causes and causes[0].kind != ABSENT else findings or causes


def doctor(arguments: Sequence[str]) -> None:
    """Print what is wrong; exits with 1 if anything is."""
    given = with_frames(own.split_arguments(arguments))
    known = [*own.field_names(FrameFiles), "data", "learnt", "output", "work", "mask", "box"]
    own.check_known(given, known, "doctor")
    cache = cache_folder(given.get("work"))
    findings = [*check_libraries(), *check_threads(), *check_disk(cache)]
    optional = [name for name in ("OpenEXR", "pyrealsense2", "OpenGL") if find_spec(name)]
    kernels = "compiled kernels" if extension() else f"numba {version('numba')}"
    print(
        f"machine   {os.cpu_count()} cores, {kernels}, onnxruntime "
        f"{version('onnxruntime')}, opencv {version('opencv-python-headless')}\n"
        f"          optional: {', '.join(optional) or 'nothing'}"
    )
    detector = None
    if "learnt" in given:
        folder = find_learnt(given["learnt"], cache)
        detector, more = examine_learnt(folder)
        print(f"learnt    {folder}")
        findings += more
    if "data" in given:
        output = expanded(given["output"]) if "output" in given else None
        print(f"data      {given['data']}")
        findings += examine_dataset(expanded(given["data"]), output)
        if output is not None:
            print(f"pictures  {output} (objects at their true poses)")
    if {"rgb", "depth", "intrinsics"} & given.keys():
        frames = OwnFrames(own.read_group(FrameFiles, given))
        print(f"frames    {given.get('rgb')}")
        findings += examine_own(frames, detector, own.search_masks(given))
    for number, finding in enumerate(findings, 1):
        print(f"{number}. {finding}")
    if findings:
        sys.exit(1)
    print("nothing wrong was found")
