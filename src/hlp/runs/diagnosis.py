"""Causes of misses, quality of votes, classes of windows, from the outputs of the stages.

What needs a frame's images is counted while the frame is decoded (`note_frame`), for every target.
The rest is found out afterwards, for missed targets alone (`explain_misses`).
"""

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from tqdm import tqdm

from hlp.data.dataset import Dataset, FrameSource, annotated_mask
from hlp.errors import DataError
from hlp.evaluation.bop_recalls import unoccluded_mask
from hlp.evaluation.errors import is_symmetric_flip, near_truth, poses_near_truth
from hlp.evaluation.evaluator import FrameTruth, add_correct
from hlp.evaluation.settings import EvaluationSettings
from hlp.evaluation.waterfall import TargetCounts, TargetResults, VoteCounts, cause_of
from hlp.geometry import project, transform
from hlp.method.find.trace import ObjectTrace, Stage, Trace
from hlp.models.classifier import class_probabilities
from hlp.models.network import Network
from hlp.patches.holistic import Windows, center_depths
from hlp.patches.window_images import WindowImages
from hlp.records import Frame, ObjectModel, Region, Target, TargetScore, Votes, frame_key
from hlp.stages.detection import DetectionStages
from hlp.stages.trace_files import read_trace
from hlp.stages.training import TrainingStages
from hlp.thread_team import ThreadTeam

Mask = Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class TargetNotes:
    """A target with what is counted for it.

    `middle` is the pixel (x, y) that shows it nearest to its centroid; None where it is not seen.
    """

    target: Target
    counts: TargetCounts
    middle: tuple[int, int] | None


@dataclass(frozen=True)
class FrameNotes:
    """What scoring and diagnosis need of a frame; no image is kept.

    `votes` are counted for each object that is looked for; `targets` are in the order in which
    `score_targets` scores them.
    """

    truth: FrameTruth
    votes: tuple[VoteCounts, ...]
    targets: tuple[TargetNotes, ...]


def note_frame(
    dataset: Dataset, frame: Frame, trace: Trace, settings: EvaluationSettings
) -> FrameNotes:
    """Count what the stages found in a frame; a vote is good near the true pose of any target."""
    counted: list[VoteCounts] = []
    notes: list[TargetNotes] = []
    for object_id in dict.fromkeys(target.object_id for target in frame.targets):
        model, found = dataset.models[object_id], trace[object_id]
        votes, region = found.votes, found.region
        assert votes is not None and region is not None
        good, shown = [], []
        for target in frame.targets:
            if target.object_id == object_id:
                good.append(good_votes(votes, target, model, settings))
                shown.append(visible_pixels(dataset.frames, frame, target, model))
                counts = _count(frame, shown[-1], region, int(good[-1].sum()))
                notes.append(TargetNotes(target, counts, _middle(frame, shown[-1], target, model)))
        x, y = votes.pixels.astype(int).T
        on_object = np.any(shown, axis=0)[y, x]
        counted.append(VoteCounts.of(object_id, np.any(good, axis=0), votes.weights, on_object))
    return FrameNotes(FrameTruth.of(frame, with_depth=True), tuple(counted), tuple(notes))


def good_votes(
    votes: Votes, target: Target, model: ObjectModel, settings: EvaluationSettings
) -> Bool[np.ndarray, "v"]:
    """Which votes are near a target's true pose."""
    bounds = (settings.waterfall.vote_deg, settings.waterfall.vote_mm)
    return near_truth(
        votes.rotations_cam_obj, votes.centroids_cam, target.pose_cam_obj, model, settings, bounds
    )


def visible_pixels(source: FrameSource, frame: Frame, target: Target, model: ObjectModel) -> Mask:
    """Pixels that show the target: the data set's own mask, or else where nothing hides it.

    A broken mask is reported and not used: it explains misses, but poses do not need it.
    """
    try:
        annotated = annotated_mask(source, frame, target)
    except DataError as error:
        logging.getLogger(__name__).warning("frame %s: its mask is not used: %s", frame.key, error)
        annotated = None
    return unoccluded_mask(frame, target, model) if annotated is None else annotated


def _middle(
    frame: Frame, visible: Mask, target: Target, model: ObjectModel
) -> tuple[int, int] | None:
    """The pixel (x, y) with depth that shows a target nearest to its centroid; None without any."""
    y, x = np.nonzero(visible & (frame.depth > 0))
    if len(x) == 0:
        return None
    center = project(transform(target.pose_cam_obj, model.centroid[None]), frame.camera_matrix)[0]
    nearest = np.hypot(x - center[0], y - center[1]).argmin()
    return int(x[nearest]), int(y[nearest])


def _count(frame: Frame, visible: Mask, region: Region, good: int) -> TargetCounts:
    x, y = np.rint(region.centers).astype(int).T
    return TargetCounts(
        visible=int(visible.sum()),
        with_depth=int((visible & (frame.depth > 0)).sum()),
        windows=int(visible[y, x].sum()),
        in_region=int((visible & region.mask).sum()),
        good_votes=good,
    )


def explain_misses(
    detection: DetectionStages,
    notes: Sequence[FrameNotes],
    scores: Sequence[TargetScore],
    settings: EvaluationSettings,
) -> list[TargetScore]:
    """The scores, with the cause of the miss for each missed target.

    `scores` holds one score per target, from `score_targets` with the frames in the order of the
    notes.
    """
    # The targets of a frame follow each other, so its two files are read once.
    folders: dict[Stage, Path] = {
        "hypotheses": detection.hypotheses().folder,
        "poses": detection.poses().folder,
    }
    read = lru_cache(maxsize=1)(partial(read_trace, folders))
    explained = []
    pairs = list(zip(scores, (target for frame in notes for target in frame.targets), strict=True))
    for score, noted in tqdm(pairs, "causes of misses", unit="target", disable=None):
        if not score.add_correct:
            trace = read(frame_key(score.scene_id, score.frame_id))
            assert not isinstance(trace, str)  # what has failed has no notes
            model = detection.dataset.models[noted.target.object_id]
            results = _results(trace[noted.target.object_id], noted, model, settings)
            score = dataclasses.replace(score, cause=cause_of(results, settings.waterfall))
        explained.append(score)
    return explained


def _results(
    found: ObjectTrace, noted: TargetNotes, model: ObjectModel, settings: EvaluationSettings
) -> TargetResults:
    true, fine, coarse = noted.target.pose_cam_obj, found.refined, found.hypotheses
    assert coarse is not None
    refined = [] if fine is None else [pose.pose_cam_obj for pose in fine.refined]
    chosen = [] if fine is None else fine.chosen_poses
    sources = np.zeros(0, dtype=int) if fine is None else fine.sources
    basin = (settings.waterfall.basin_deg, settings.waterfall.basin_mm)
    return TargetResults(
        noted.counts,
        near_basin=poses_near_truth(coarse.poses_cam_obj, true, model, settings, basin),
        refined=sources[sources >= 0],  # the others come from the fallback
        right=add_correct(np.reshape(refined, (-1, 4, 4)), true, model, settings),
        flipped=any(is_symmetric_flip(pose, true, model, settings) for pose in chosen),
    )


class WindowClasses:
    """Counts the classes of the windows at targets, by name; objects as rows, class in each.

    A window is cut by the rule of all windows (paper, Eq. 1), where the target is seen nearest to
    its centroid. A target of which nothing can be seen has none.
    """

    def __init__(self, training: TrainingStages) -> None:
        self._training = training
        models = training.models
        self._names = ["background", *(models[i].name for i in training.classes)]
        self._counts: dict[str, dict[str, int]] = {}

    @cached_property
    def _network(self) -> Network:
        return self._training.load_classifier()

    def count(self, frame: Frame, notes: FrameNotes) -> None:
        """Classify the windows at a frame's targets."""
        settings = self._training.settings
        team = ThreadTeam(settings.machine.threads)
        images = WindowImages(frame.rgb, frame.depth, settings.patches.holistic, team)
        focal = float(frame.camera_matrix[0, 0] + frame.camera_matrix[1, 1]) / 2
        for noted in notes.targets:
            if noted.middle is None:
                continue
            model = self._training.models[noted.target.object_id]
            center = np.array([noted.middle])
            depth = center_depths(frame.depth, center)
            sides = focal * model.holistic_size / depth
            window = Windows(center.astype(np.float64), depth, sides)
            cut = images.cut(window, model.holistic_size)
            said = self._names[int(class_probabilities(self._network, cut)[0].argmax())]
            row = self._counts.setdefault(model.name, {})
            row[said] = row.get(said, 0) + 1

    def summary(self) -> dict[str, dict[str, int]]:
        """The counts, in the order of the classes; objects that are no targets are left out."""
        rows = {true: self._counts[true] for true in self._names if true in self._counts}
        return {
            true: {said: row[said] for said in self._names if said in row}
            for true, row in rows.items()
        }
