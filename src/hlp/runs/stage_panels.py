"""What the stages found in single frames, from their outputs on disk, as pictures."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from tqdm import tqdm

from hlp.config.build import Run, evenly
from hlp.method.find.trace import Trace
from hlp.records import Frame, PoseEstimate, Target, TargetScore, frame_key
from hlp.reporting.figures.panels import write_picture
from hlp.reporting.figures.target_panels import SeenTarget, draw_panels
from hlp.reporting.figures.tiles import ShownPose, draw_overview
from hlp.stages.detection import DetectionStages

PANELS = "panels"
"""Folder of a run's pictures of some frames."""


@dataclass(frozen=True)
class FoundInFrame:
    """A frame with what the stages found in it, and the answers."""

    frame: Frame
    trace: Trace
    estimates: tuple[PoseEstimate, ...]

    @classmethod
    def read(
        cls, detection: DetectionStages, key: str, estimates: Sequence[PoseEstimate]
    ) -> "FoundInFrame":
        """What lies on disk of a frame that did not fail; `estimates` are the run's."""
        trace = detection.read(key)
        here = [each for each in estimates if frame_key(each.scene_id, each.frame_id) == key]
        return cls(detection.load(key), trace, tuple(here))

    def nearest(self, target: Target) -> PoseEstimate | None:
        """The answer for the target's object that is nearest to its true place."""

        def distance(estimate: PoseEstimate) -> float:
            assert estimate.pose_cam_obj is not None
            apart = estimate.pose_cam_obj[:3, 3] - target.pose_cam_obj[:3, 3]
            return float(np.linalg.norm(apart))

        same = [each for each in self.estimates if each.object_id == target.object_id]
        found = [each for each in same if each.pose_cam_obj is not None]
        return min(found, key=distance, default=None)

    def coarse(
        self, object_id: int, estimate: PoseEstimate | None
    ) -> Float[np.ndarray, "4 4"] | None:
        """The coarse pose that became the estimate; without an estimate the best one.

        None if there is none: the fallback finds poses without any.
        """
        found = self.trace[object_id]
        poses = np.zeros((0, 4, 4)) if found.hypotheses is None else found.hypotheses.poses_cam_obj
        row = self.row(object_id, estimate)
        if row is None or found.refined is None:
            return poses[0] if len(poses) else None
        source = int(found.refined.sources[row])
        return poses[source] if 0 <= source < len(poses) else None

    def row(self, object_id: int, estimate: PoseEstimate | None) -> int | None:
        """Which of the object's refined poses is the estimate; None without one."""
        refined = self.trace[object_id].refined
        if estimate is None or estimate.pose_cam_obj is None or refined is None:
            return None
        poses = np.stack([found.pose_cam_obj for found in refined.refined])
        return int(np.abs(poses - estimate.pose_cam_obj).max(axis=(1, 2)).argmin())


def picture_of_target(
    detection: DetectionStages, found: FoundInFrame, target: Target, score: TargetScore
) -> UInt8[np.ndarray, "_ _ 3"]:
    """The panels of a target with its verdict."""
    object_id, frame = target.object_id, found.frame
    best, trace = found.nearest(target), found.trace[object_id]
    assert trace.region is not None and trace.votes is not None
    seen = SeenTarget(
        frame=frame,
        model=detection.dataset.models[object_id],
        region=trace.region,
        votes=trace.votes,
        coarse=found.coarse(object_id, best),
        estimate=best,
        truth=target,
        score=score,
    )
    return draw_panels(seen)


def draw_frames(
    run: Run,
    detection: DetectionStages,
    estimates: Sequence[PoseEstimate],
    scores: Sequence[TargetScore],
    output: Path,
) -> None:
    """Draw some frames into `output`/panels: all poses, and the panels of one target in turn.

    `panels` frames are drawn, spread evenly. Nothing that goes wrong here costs the run its
    results: it is logged, with its traceback.
    """
    if run.settings.panels == 0:
        return
    folder = output / PANELS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        keys = evenly(run.keys, run.settings.panels)
        for number, key in enumerate(tqdm(keys, desc="pictures", unit="frame", disable=None)):
            if key not in detection.failed:
                _draw_frame(detection, key, number, estimates, scores, folder)
    except Exception:
        logging.getLogger(__name__).exception("the pictures in %s could not be made", folder)


def _draw_frame(
    detection: DetectionStages,
    key: str,
    number: int,
    estimates: Sequence[PoseEstimate],
    scores: Sequence[TargetScore],
    folder: Path,
) -> None:
    found = FoundInFrame.read(detection, key, estimates)
    here = [each for each in scores if frame_key(each.scene_id, each.frame_id) == key]
    if not here:
        return
    write_picture(folder / f"{key}_poses.jpg", _overview(detection, found, here))
    place = number % len(here)
    target = in_order_of_scores(found.frame)[place]
    name = detection.dataset.models[target.object_id].name
    picture = picture_of_target(detection, found, target, here[place])
    write_picture(folder / f"{key}_{name}.jpg", picture)


def in_order_of_scores(frame: Frame) -> list[Target]:
    """A frame's targets as they are scored: object by object, in the order of first appearance."""
    objects = dict.fromkeys(target.object_id for target in frame.targets)
    return [each for i in objects for each in frame.targets if each.object_id == i]


def _overview(
    detection: DetectionStages, found: FoundInFrame, scores: Sequence[TargetScore]
) -> UInt8[np.ndarray, "_ _ 3"]:
    shown = []
    for target, score in zip(in_order_of_scores(found.frame), scores, strict=True):
        estimate = found.nearest(target)
        if estimate is not None and estimate.pose_cam_obj is not None:
            model = detection.dataset.models[target.object_id]
            words = f"{model.name} {estimate.score:.2f}"
            shown.append(ShownPose(model, estimate.pose_cam_obj, words, score.add_correct))
    right = sum(each.add_correct for each in scores)
    missing = len(scores) - len(shown)
    title = f"{found.frame.key}: {right} of {len(scores)} targets right"
    title += f", {missing} without an answer" if missing else ""
    return draw_overview(found.frame, shown, title)
