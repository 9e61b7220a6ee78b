"""Causes of missed targets and quality of votes, from the outputs of the stages."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from hlp.data.sources import FrameSource, annotated_mask
from hlp.evaluation.evaluator import add_correct
from hlp.evaluation.pose_distance import is_symmetric_flip, near_truth, poses_near_truth
from hlp.evaluation.settings import EvaluationSettings
from hlp.evaluation.visible_mask import unoccluded_mask
from hlp.evaluation.vote_quality import VoteCounts
from hlp.evaluation.waterfall import Evidence, cause_of
from hlp.geometry import rotation_matrices
from hlp.records import Frame, ObjectModel, Region, Target, TargetScore, frame_key
from hlp.stages.detection import DetectionStages
from hlp.stages.frame_files import read_arrays
from hlp.stages.frame_results import Arrays, read_regions


def explain_misses(
    detection: DetectionStages, scores: Sequence[TargetScore], settings: EvaluationSettings
) -> list[TargetScore]:
    """The scores, with the cause of the miss for each missed target.

    `scores` holds one score per target, in the order of `score_targets`: by frame, and for each
    object in the order of its targets.
    """
    frames: dict[str, dict[int, list[int]]] = {}
    for index, score in enumerate(scores):
        key = frame_key(score.scene_id, score.frame_id)
        frames.setdefault(key, {}).setdefault(score.object_id, []).append(index)
    explained = list(scores)
    for key, objects in frames.items():
        missed = {
            object_id: indices
            for object_id, indices in objects.items()
            if not all(scores[index].add_correct for index in indices)
        }
        if missed:
            diagnosis = _FrameDiagnosis(detection, settings, key)
            for object_id, indices in missed.items():
                for place, index in enumerate(indices):
                    if not scores[index].add_correct:
                        cause = diagnosis.cause(object_id, place)
                        explained[index] = dataclasses.replace(scores[index], cause=cause)
    return explained


class _FrameDiagnosis:
    """Evidence for the targets of one frame; each file is read once."""

    def __init__(self, detection: DetectionStages, settings: EvaluationSettings, key: str) -> None:
        self._models = detection.dataset.models
        self._settings = settings
        self._source = detection.dataset.frames
        self._frame = self._source.load(key)
        self._regions = read_regions(detection.regions().folder, self._frame)
        self._coarse = read_arrays(detection.hypotheses().folder, key)
        self._fine = read_arrays(detection.poses().folder, key)

    def cause(self, object_id: int, place: int) -> str:
        """Why the `place`-th target of this object in the frame was missed."""
        targets = [each for each in self._frame.targets if each.object_id == object_id]
        evidence = self._evidence(targets[place], self._models[object_id])
        return cause_of(evidence, self._settings.waterfall)

    def _evidence(self, target: Target, model: ObjectModel) -> Evidence:
        settings, true = self._settings, target.pose_cam_obj
        name, region = str(target.object_id), self._regions[target.object_id]
        visible = visible_pixels(self._source, self._frame, target, model)
        poses = self._fine.get(f"{name}/poses", np.zeros((0, 4, 4)))
        instances = poses[self._fine[f"{name}/instances"]] if len(poses) else poses
        basin = (settings.waterfall.basin_deg, settings.waterfall.basin_mm)
        return Evidence(
            visible=int(visible.sum()),
            with_depth=int((visible & (self._frame.depth > 0)).sum()),
            windows=_windows_on(visible, region),
            in_region=int((visible & region.mask).sum()),
            good_votes=int(good_votes(self._coarse, target, model, settings).sum()),
            near_basin=poses_near_truth(
                self._coarse[f"{name}/poses"], true, model, settings, basin
            ),
            refined=self._fine.get(f"{name}/sources", np.zeros(0, dtype=int)),
            right=add_correct(poses, true, model, settings),
            flipped=any(is_symmetric_flip(each, true, model, settings) for each in instances),
        )


def count_votes(
    detection: DetectionStages, frame: Frame, settings: EvaluationSettings
) -> list[VoteCounts]:
    """Counts of the votes for every object that is looked for in a frame.

    A vote is good if it is near the true pose of any of the object's targets in the frame.
    """
    stored = read_arrays(detection.hypotheses().folder, frame.key)
    counted = []
    for object_id in detection.dataset.wanted(frame):
        model = detection.dataset.models[object_id]
        targets = [each for each in frame.targets if each.object_id == object_id]
        good = [good_votes(stored, each, model, settings) for each in targets]
        shown = [visible_pixels(detection.dataset.frames, frame, each, model) for each in targets]
        x, y = stored[f"{object_id}/vote_pixels"].T
        on_object = np.any(shown, axis=0)[y, x]
        weights = stored[f"{object_id}/vote_weights"].astype(np.float64)
        counted.append(VoteCounts.of(object_id, np.any(good, axis=0), weights, on_object))
    return counted


def good_votes(
    stored: Arrays, target: Target, model: ObjectModel, settings: EvaluationSettings
) -> Bool[np.ndarray, "v"]:
    """Which of the stored votes are near a target's true pose."""
    name = str(target.object_id)
    return near_truth(
        rotation_matrices(stored[f"{name}/vote_quaternions"]),
        stored[f"{name}/vote_centroids"],
        target.pose_cam_obj,
        model,
        settings,
        (settings.waterfall.vote_deg, settings.waterfall.vote_mm),
    )


def visible_pixels(
    source: FrameSource, frame: Frame, target: Target, model: ObjectModel
) -> Bool[np.ndarray, "h w"]:
    """Pixels that show the target: the data set's own mask, or else where nothing hides it."""
    annotated = annotated_mask(source, frame, target)
    return unoccluded_mask(frame, target, model) if annotated is None else annotated


def _windows_on(visible: Bool[np.ndarray, "h w"], region: Region) -> int:
    x, y = np.rint(region.centers).astype(int).T
    return int(visible[y, x].sum())
