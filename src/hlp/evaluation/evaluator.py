"""Scores estimates against the true poses: errors and verdicts of each target (paper, Sec. 4).

Recall counts targets. A target without an estimate is wrong. Estimates of objects that are no
target, or beyond the number of targets, are ignored.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull, QhullError, cKDTree

from hlp.errors import DataError
from hlp.evaluation import errors
from hlp.evaluation.settings import EvaluationSettings
from hlp.records import Frame, ObjectModel, PoseEstimate, Target, TargetScore
from hlp.rendering.rasterizer import render_depth

Pose = Float[np.ndarray, "4 4"]

# BOP Challenge 2020, Sec. 2.2: recalls are averaged over these thresholds.
_BOP_FRACTIONS = np.arange(1, 11) * 0.05
_BOP_PIXELS = np.arange(1, 11) * 5.0
_BOP_WIDTH = 640
_FEW_VERTICES = 2000


@dataclass(frozen=True)
class FrameTruth:
    """The part of a frame that scoring needs; `depth` (m) only if VSD is wanted."""

    scene_id: int
    frame_id: int
    camera_matrix: Float[np.ndarray, "3 3"]
    width: int
    targets: tuple[Target, ...]
    depth: Float[np.ndarray, "h w"] | None = None

    @classmethod
    def of(cls, frame: Frame, with_depth: bool = False) -> "FrameTruth":
        """Take from a frame what scoring needs."""
        return cls(
            frame.scene_id,
            frame.frame_id,
            frame.camera_matrix,
            frame.rgb.shape[1],
            frame.targets,
            frame.depth if with_depth else None,
        )


def score_targets(
    truths: Iterable[FrameTruth],
    models: Mapping[int, ObjectModel],
    estimates: Iterable[PoseEstimate],
    settings: EvaluationSettings,
) -> list[TargetScore]:
    """One score for each target, frame by frame and, within a frame, object by object.

    A target without an estimate, or whose estimate has no pose, is wrong with infinite errors.
    Where a frame holds several instances of an object, estimates are matched to them greedily: the
    one with the highest score first, to the instance with the smallest ADD(-S).
    Raises ValueError for a pose with NaN, and DataError for a target whose object has no model.
    """
    estimates_of: dict[tuple[int, int, int], list[PoseEstimate]] = {}
    for estimate in estimates:
        _check_finite(estimate)
        key = (estimate.scene_id, estimate.frame_id, estimate.object_id)
        estimates_of.setdefault(key, []).append(estimate)
    scorers: dict[int, _ObjectScorer] = {}
    scores = []
    for truth in truths:
        for object_id in dict.fromkeys(target.object_id for target in truth.targets):
            if object_id not in models:
                raise DataError(f"targets ask for object {object_id}, which has no model")
            if object_id not in scorers:
                scorers[object_id] = _ObjectScorer(models[object_id], settings)
            found = estimates_of.get((truth.scene_id, truth.frame_id, object_id), [])
            scores += scorers[object_id].score(truth, found)
    return scores


def add_correct(
    poses_cam_obj: Float[np.ndarray, "n 4 4"],
    true_pose: Float[np.ndarray, "4 4"],
    model: ObjectModel,
    settings: EvaluationSettings,
) -> Bool[np.ndarray, "n"]:
    """Verdict of ADD(-S) on many poses of one target, by the same policy as `score_targets`."""
    scorer = _ObjectScorer(model, settings)
    distances = np.array([scorer.add_error(pose, true_pose) for pose in poses_cam_obj])
    return distances < scorer.add_limit


class _ObjectScorer:
    """Scores the targets of one object; keeps what its errors need more than once."""

    def __init__(self, model: ObjectModel, settings: EvaluationSettings) -> None:
        self._model, self._settings = model, settings
        self._vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
        self.add_limit = settings.add_fraction * model.diameter
        self._symmetric = settings.is_symmetric(model)
        self._tree = cKDTree(self._vertices) if self._symmetric else None
        self._few_vertices = self._vertices[:: max(1, len(self._vertices) // _FEW_VERTICES)]
        self._few_tree = cKDTree(self._few_vertices)
        try:
            self._hull = self._vertices[ConvexHull(self._vertices).vertices]
        except QhullError:  # a flat object
            self._hull = self._vertices

    def score(self, truth: FrameTruth, estimates: Sequence[PoseEstimate]) -> list[TargetScore]:
        """Scores of all targets of this object in one frame."""
        targets = [t for t in truth.targets if t.object_id == self._model.object_id]
        matched = self._match(targets, estimates)
        return [
            self._missing(truth, target) if found is None else self._score(truth, target, *found)
            for target, found in zip(targets, matched, strict=True)
        ]

    def _match(
        self, targets: Sequence[Target], estimates: Sequence[PoseEstimate]
    ) -> list[tuple[Pose, float] | None]:
        """Pose and score of the estimate of each target."""
        matched: list[tuple[Pose, float] | None] = [None] * len(targets)
        for estimate in sorted(estimates, key=lambda item: -item.score):
            free = [i for i, each in enumerate(matched) if each is None]
            pose = estimate.pose_cam_obj
            if pose is not None and free:
                matched[self._closest(targets, free, pose)] = pose, estimate.score
        return matched

    def _closest(self, targets: Sequence[Target], free: Sequence[int], pose: Pose) -> int:
        if len(free) == 1:
            return free[0]
        return min(free, key=lambda i: self.add_error(pose, targets[i].pose_cam_obj))

    def add_error(self, estimated: Pose, true: Pose) -> float:
        """ADD(-S) in metres: ADD-S where the policy calls the object symmetric, else ADD."""
        if self._symmetric:
            return errors.add_s(estimated, true, self._vertices, self._tree)
        return errors.add(estimated, true, self._vertices)

    def _add_s(self, estimated: Pose, true: Pose) -> float:
        """ADD-S (m) over about 2000 of the vertices."""
        return errors.add_s(estimated, true, self._few_vertices, self._few_tree)

    def _score(self, truth: FrameTruth, target: Target, pose: Pose, score: float) -> TargetScore:
        settings, true = self._settings, target.pose_cam_obj
        alike = true
        if self._symmetric:
            alike = errors.nearest_symmetric_pose(pose, true, self._model.symmetries)
        add_error = self.add_error(pose, true)
        turn = errors.rotation_error(pose, alike)
        shift = errors.translation_error(pose, alike)
        iou = errors.box_iou(pose, true, self._vertices, truth.camera_matrix)
        near = shift < settings.translation_cm * 1e-2
        return TargetScore(
            truth.scene_id,
            truth.frame_id,
            target.object_id,
            found=True,
            visible_fraction=target.visible_fraction,
            add_error=add_error,
            rotation_error=turn,
            translation_error=shift,
            box_iou=iou,
            add_correct=add_error < self.add_limit,
            pose_correct=near and turn < math.radians(settings.rotation_deg),
            box_correct=iou >= settings.iou,
            mssd_recall=self._mssd_recall(pose, true),
            mspd_recall=self._mspd_recall(pose, true, truth),
            vsd_recall=self._vsd_recall(pose, true, truth),
            score=score,
            add_s_correct=self._add_s(pose, true) < self.add_limit,
        )

    def _mssd_recall(self, pose: Pose, true: Pose) -> float:
        error = errors.mssd(pose, true, self._hull, self._model.symmetries)
        return float((error < _BOP_FRACTIONS * self._model.diameter).mean())

    def _mspd_recall(self, pose: Pose, true: Pose, truth: FrameTruth) -> float:
        # The error is largest on the convex hull, up to an effect of perspective that is far below
        # the thresholds' steps of 5 px.
        error = errors.mspd(pose, true, self._hull, self._model.symmetries, truth.camera_matrix)
        return float((error < _BOP_PIXELS * truth.width / _BOP_WIDTH).mean())

    def _vsd_recall(self, pose: Pose, true: Pose, truth: FrameTruth) -> float:
        if truth.depth is None:
            return float("nan")
        height, width = truth.depth.shape
        rendered = render_depth(
            self._model.mesh, np.stack([pose, true]), truth.camera_matrix, (height, width)
        )
        tolerances = list(_BOP_FRACTIONS * self._model.diameter)
        values = errors.vsd(rendered[0], rendered[1], truth.depth, truth.camera_matrix, tolerances)
        return float((values[:, None] < _BOP_FRACTIONS).mean())

    def _missing(self, truth: FrameTruth, target: Target) -> TargetScore:
        infinite = float("inf")
        return TargetScore(
            truth.scene_id,
            truth.frame_id,
            target.object_id,
            found=False,
            visible_fraction=target.visible_fraction,
            add_error=infinite,
            rotation_error=infinite,
            translation_error=infinite,
            box_iou=0.0,
            add_correct=False,
            pose_correct=False,
            box_correct=False,
            mssd_recall=0.0,
            mspd_recall=0.0,
            vsd_recall=float("nan") if truth.depth is None else 0.0,
        )


def _check_finite(estimate: PoseEstimate) -> None:
    pose = estimate.pose_cam_obj
    if pose is not None and not np.isfinite(pose).all():
        raise ValueError(
            f"the estimate of object {estimate.object_id} in scene {estimate.scene_id}, frame"
            f" {estimate.frame_id} holds NaN or infinity"
        )
