"""Causes of misses and quality of votes, from the outputs of the stages.

What needs a frame's images is counted while the frame is decoded (`note_frame`), for every target.
The rest is found out afterwards, for missed targets alone (`explain_misses`).
"""

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from hlp.arrays import Mask
from hlp.data.dataset import Dataset, FrameSource, annotated_mask
from hlp.errors import DataError
from hlp.evaluation import EvaluationSettings
from hlp.evaluation.bop_recalls import unoccluded_mask
from hlp.evaluation.errors import BASIN, is_symmetric_flip, near_truth
from hlp.evaluation.evaluator import FrameTruth, add_correct
from hlp.evaluation.waterfall import TargetCounts, VoteCounts, cause_of
from hlp.geometry import transform
from hlp.method.find.trace import ObjectTrace, Stage, Trace
from hlp.progress import Progress
from hlp.records import Frame, ObjectModel, Region, Target, TargetScore, frame_key
from hlp.stages.detection import DetectionStages
from hlp.stages.trace_files import read_trace

_GOOD = 15.0, 20.0  # degrees and mm of a good vote from the truth (D)


@dataclass(frozen=True)
class FrameNotes:
    """What scoring and diagnosis need of a frame; no image is kept.

    `votes` are counted for each object that is looked for; `targets`, with what is counted for
    them, are in the order in which `score_targets` scores them.
    """

    truth: FrameTruth
    votes: tuple[VoteCounts, ...]
    targets: tuple[tuple[Target, TargetCounts], ...]


def note_frame(
    dataset: Dataset, frame: Frame, trace: Trace, settings: EvaluationSettings
) -> FrameNotes:
    """Count what the stages found in a frame; a vote is good near the true pose of any target."""
    counted: list[VoteCounts] = []
    notes: list[tuple[Target, TargetCounts]] = []
    for object_id in dict.fromkeys(target.object_id for target in frame.targets):
        model, found = dataset.models[object_id], trace[object_id]
        votes, region = found.votes, found.region
        assert votes is not None and region is not None
        good, shown = [], []
        for target in frame.targets:
            if target.object_id == object_id:
                places = votes.rotations_cam_obj, votes.centroids_cam, target.pose_cam_obj
                good.append(near_truth(*places, model, settings, _GOOD))
                shown.append(visible_pixels(dataset.frames, frame, target, model))
                notes.append((target, _count(frame, shown[-1], region, int(good[-1].sum()))))
        x, y = votes.pixels.astype(int).T
        on_object = np.any(shown, axis=0)[y, x]
        counted.append(VoteCounts.of(object_id, np.any(good, axis=0), votes.weights, on_object))
    return FrameNotes(FrameTruth.of(frame, with_depth=True), tuple(counted), tuple(notes))


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

    `scores` holds one score per target, from `score_targets` in the order of the notes.
    """
    # The targets of a frame follow each other, so its two files are read once.
    stages: tuple[Stage, ...] = ("hypotheses", "poses")
    folders = {stage: detection.make(stage).folder for stage in stages}
    read = lru_cache(maxsize=1)(partial(read_trace, folders))
    explained = []
    pairs = list(zip(scores, (noted for frame in notes for noted in frame.targets), strict=True))
    for score, (target, counts) in Progress(pairs, "causes of misses", unit="target"):
        if not score.add_correct:
            trace = read(frame_key(score.scene_id, score.frame_id))
            assert not isinstance(trace, str)  # what has failed has no notes
            model = detection.dataset.models[target.object_id]
            cause = _cause(trace[target.object_id], target, counts, model, settings)
            score = dataclasses.replace(score, cause=cause)
        explained.append(score)
    return explained


def _cause(
    found: ObjectTrace,
    target: Target,
    counts: TargetCounts,
    model: ObjectModel,
    settings: EvaluationSettings,
) -> str:
    true, fine, coarse = target.pose_cam_obj, found.refined, found.hypotheses
    assert coarse is not None
    refined = [] if fine is None else [pose.pose_cam_obj for pose in fine.refined]
    chosen = [] if fine is None else fine.chosen_poses
    sources = np.zeros(0, dtype=int) if fine is None else fine.sources
    poses = coarse.poses_cam_obj
    places = poses[:, :3, :3], transform(poses, model.centroid[None])[:, 0]
    return cause_of(
        counts,
        near_basin=near_truth(*places, true, model, settings, BASIN),
        refined=sources[sources >= 0],  # the others come from the fallback
        right=add_correct(np.reshape(refined, (-1, 4, 4)), true, model, settings),
        flipped=any(is_symmetric_flip(pose, true, model, settings) for pose in chosen),
    )
