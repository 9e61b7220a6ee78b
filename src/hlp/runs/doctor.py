"""`hlp doctor`: what is wrong with a data set, frames, learnt objects or this machine."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hlp.checks import camera, machine
from hlp.checks.color_order import all_answers, check_color_order, exchange_gain
from hlp.checks.depth_ratio import check_depth_ratio, ratio_gains
from hlp.checks.finding import Finding
from hlp.checks.frame_checks import check_frames, read_frames
from hlp.checks.true_poses import check_true_poses
from hlp.checks.unit_search import check_by_search
from hlp.data.bop import BopFrames, BopSettings
from hlp.data.dataset import Dataset
from hlp.data.own_frames import OwnFrames
from hlp.errors import HlpError
from hlp.method.detections import Detection
from hlp.method.detector import Detector
from hlp.records import Frame
from hlp.reporting.figures.panels import draw_detections, write_picture

_KEPT = 6  # frames whose content is looked at
_SEARCHED = 2  # frames in which objects are looked for
_LAYOUT = (
    "The folder must be in BOP's layout: models/obj_000001.ply …, and for each scene "
    "test/000001/rgb/, depth/, scene_camera.json and scene_gt.json"
)


def examine_machine(cache: Path) -> list[Finding]:
    """Libraries, threads and disk."""
    return [*machine.check_libraries(), *machine.check_threads(), *machine.check_disk(cache)]


def examine_learnt(folder: Path) -> tuple[Detector | None, list[Finding]]:
    """Learnt objects, all loaded; None if they cannot be."""
    try:
        detector = Detector.load(folder)
        detector.warm_up()
        return detector, camera.check_object_size(list(detector.models.values()))
    except HlpError as error:
        return None, [Finding("learnt objects", str(folder), str(error), "Learn them again")]


def examine_dataset(root: Path, output: Path | None) -> list[Finding]:
    """A data set in BOP's layout: files, cameras, and whether poses fit the depth images.

    With `output` some frames are drawn there with the objects at their true poses.
    """
    try:
        dataset = BopSettings(name="bop", root=str(root)).build()
        keys = dataset.frames.keys
    except HlpError as error:
        return [Finding("data set", str(root), str(error), _LAYOUT)]
    source = dataset.frames
    read = source.read if isinstance(source, BopFrames) else None
    frames, findings = read_frames(source.load, keys, _KEPT, read)
    causes = check_frames(frames, list(dataset.models.values()))
    causes += check_true_poses(frames, dataset.models)
    # Values that make no sense have a cause; where it is known, only the cause is said.
    findings = [each for each in findings if not causes or each.kind != "values"] + causes
    if output is not None:
        for frame in frames:
            _draw_truth(output, dataset, frame)
    return findings


def examine_own(frames: OwnFrames, detector: Detector | None) -> list[Finding]:
    """A user's own frames, with learnt objects to look for or without."""
    try:
        keys = frames.keys
        _ = frames.camera
    except HlpError as error:
        return [Finding("files", "frames", str(error), "Correct it and call again")]
    read, findings = read_frames(frames.load, keys, _KEPT)
    models = [] if detector is None else list(detector.models.values())
    findings += check_frames(read, models)
    if detector is not None and not findings:
        findings += check_by_search(read[:_SEARCHED], lambda frame: _best(detector, frame))
    if detector is not None and not findings:
        findings += _examine_fits(detector, read)
    return findings


def _examine_fits(detector: Detector, frames: Sequence[Frame]) -> list[Finding]:
    """Faults with which objects are found all the same, but fit worse in most frames."""
    exchanges: list[float] = []
    ratios: list[dict[float, float]] = []
    for frame in frames:
        answers = _answers(detector, frame)
        exchanges += _exchange_gains(detector, frame, answers)
        ratios.append(ratio_gains(frame, answers, partial(_answers, detector)))
    return [*check_color_order(exchanges), *check_depth_ratio(ratios)]


def _exchange_gains(
    detector: Detector, frame: Frame, answers: Sequence[Detection]
) -> Iterator[float]:
    """How much better known objects fit with red and blue exchanged, found either way."""
    exchanged = replace(frame, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))
    stated = exchange_gain(frame, detector.models, answers)
    other = exchange_gain(exchanged, detector.models, _answers(detector, exchanged))
    gains = [gain for gain in (stated, None if other is None else -other) if gain is not None]
    if gains:
        yield float(np.mean(gains))


def _answers(detector: Detector, frame: Frame) -> list[Detection]:
    """The best answer for each object, whatever its score."""
    found = detector.search(
        frame.rgb, frame.depth, frame.camera_matrix, max_instances=1, min_score=0.0
    )
    return all_answers(found)


def _best(detector: Detector, frame: Frame) -> float:
    if camera.check_depth_scale(frame, list(detector.models.values())):
        return 0.0  # objects of no size that could be found, and slow to look for
    try:
        found = detector.search(
            frame.rgb, frame.depth, frame.camera_matrix, max_instances=1, min_score=0.0
        )
    except HlpError:  # a change that makes no sense for this frame
        return 0.0
    return max((each.score for each in found.detections), default=0.0)


def _draw_truth(output: Path, dataset: Dataset, frame: Frame) -> None:
    known = [each for each in frame.targets if each.object_id in dataset.models]
    poses = [(dataset.models[each.object_id], each.pose_cam_obj) for each in known]
    output.mkdir(parents=True, exist_ok=True)
    write_picture(output / f"truth_{frame.key}.png", draw_detections(frame, poses))


def describe(findings: list[Finding]) -> Iterator[str]:
    """Findings as lines for people."""
    for number, finding in enumerate(findings, 1):
        yield f"{number}. {finding}"
    if not findings:
        yield "nothing wrong was found"
