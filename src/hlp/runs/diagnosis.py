"""Causes of missed targets and quality of votes, from the outputs of the stages."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from hlp.data.sources import FrameSource, VisibleMasks
from hlp.evaluation.errors import VSD_DELTA
from hlp.evaluation.evaluator import add_correct
from hlp.evaluation.pose_distance import (
    VoteTally,
    is_flipped,
    near_truth,
    poses_near_truth,
    tally,
)
from hlp.evaluation.settings import EvaluationSettings
from hlp.evaluation.waterfall import Evidence, cause_of
from hlp.geometry import rotation_matrices
from hlp.records import Frame, ObjectModel, Region, Target, TargetScore
from hlp.rendering.rasterizer import render_depth
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
        key = f"{score.scene_id:06d}_{score.frame_id:06d}"
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
        answer = poses[self._fine[f"{name}/best"]] if len(poses) else None
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
            flipped=answer is not None and is_flipped(answer, true, model, settings),
        )


def tally_votes(
    detection: DetectionStages, frame: Frame, settings: EvaluationSettings
) -> list[VoteTally]:
    """Numbers of votes, of good votes and of votes from the object itself, for each object.

    A vote is good if it is near any of the object's targets in the frame.
    """
    stored = read_arrays(detection.hypotheses().folder, frame.key)
    tallies = []
    for object_id in detection.dataset.wanted(frame):
        model = detection.dataset.models[object_id]
        targets = [each for each in frame.targets if each.object_id == object_id]
        good = [good_votes(stored, each, model, settings) for each in targets]
        shown = [visible_pixels(detection.dataset.frames, frame, each, model) for each in targets]
        x, y = stored[f"{object_id}/vote_pixels"].T
        on_object = np.any(shown, axis=0)[y, x]
        weights = stored[f"{object_id}/vote_weights"].astype(np.float64)
        tallies.append(tally(object_id, np.any(good, axis=0), weights, on_object))
    return tallies


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
    """Pixels that show the target: the data set's own mask, or else by BOP's rule.

    BOP's rule: the rendered object is not farther behind the observed depth than a tolerance. A
    pixel without depth counts as visible, since nothing is known to hide the object there.
    """
    given = source.visible_mask(frame, target) if isinstance(source, VisibleMasks) else None
    if given is not None:
        return given
    shape = (frame.depth.shape[0], frame.depth.shape[1])
    rendered = render_depth(model.proxy, target.pose_cam_obj[None], frame.camera_matrix, shape)[0]
    hidden = (frame.depth > 0) & (rendered - frame.depth > VSD_DELTA)
    return np.asarray((rendered > 0) & ~hidden)


def _windows_on(visible: Bool[np.ndarray, "h w"], region: Region) -> int:
    x, y = np.rint(region.centers).astype(int).T
    return int(visible[y, x].sum())
