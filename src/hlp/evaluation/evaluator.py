"""Scores estimates against the true poses: errors and verdicts of each target (paper, Sec. 4).

Recall counts targets. A target without an estimate is wrong. Estimates of objects that are no
target, or beyond the number of targets, are ignored.
"""

import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from hlp.errors import DataError
from hlp.evaluation import errors
from hlp.evaluation.bop_recalls import BopRecalls
from hlp.evaluation.settings import EvaluationSettings
from hlp.evaluation.waterfall import missed_score
from hlp.records import Frame, Mesh, ObjectModel, PoseEstimate, Target, TargetScore

Pose = Float[np.ndarray, "4 4"]

_FEW_VERTICES = 2000


@dataclass(frozen=True)
class PackedDepth:
    """A depth image (m), compressed without loss to about an eighth, so that many can be kept."""

    shape: tuple[int, int]
    content: bytes

    @classmethod
    def of(cls, depth: Float[np.ndarray, "h w"]) -> "PackedDepth":
        """Compress an image, in single precision."""
        height, width = depth.shape
        content = np.ascontiguousarray(depth, dtype=np.float32).tobytes()
        return cls((height, width), zlib.compress(content, level=1))

    def unpack(self) -> Float[np.ndarray, "h w"]:
        """The image."""
        return np.frombuffer(zlib.decompress(self.content), np.float32).reshape(self.shape)


@dataclass(frozen=True)
class FrameTruth:
    """The part of a frame that scoring needs; `depth` only if VSD is wanted."""

    scene_id: int
    frame_id: int
    camera_matrix: Float[np.ndarray, "3 3"]
    width: int
    targets: tuple[Target, ...]
    depth: PackedDepth | None = None

    @classmethod
    def of(cls, frame: Frame, with_depth: bool = False) -> "FrameTruth":
        """Take from a frame what scoring needs."""
        return cls(
            frame.scene_id,
            frame.frame_id,
            frame.camera_matrix,
            frame.rgb.shape[1],
            frame.targets,
            PackedDepth.of(frame.depth) if with_depth else None,
        )


def score_targets(
    truths: Iterable[FrameTruth],
    models: Mapping[int, ObjectModel],
    estimates: Iterable[PoseEstimate],
    settings: EvaluationSettings,
    meshes: Mapping[int, Mesh] | None = None,
) -> list[TargetScore]:
    """Scores of the targets of several frames, see `TargetScorer`."""
    scorer = TargetScorer(models, estimates, settings, meshes)
    return [score for truth in truths for score in scorer.score(truth)]


class TargetScorer:
    """Scores the targets of one frame after the other.

    `estimates` are those of all frames. `meshes` are those on which BOP's errors are measured; by
    default and for objects that are not named the models' own.

    Of an object with n targets in a frame, the n estimates with the highest scores count. In that
    order, each is matched to the free target with the smallest ADD(-S), first those that are right,
    then the others. BOP's errors are matched by the same rule for each threshold. A target without
    an estimate, or whose estimate has no pose, is wrong with infinite errors.

    Raises ValueError for a pose with NaN.
    """

    def __init__(
        self,
        models: Mapping[int, ObjectModel],
        estimates: Iterable[PoseEstimate],
        settings: EvaluationSettings,
        meshes: Mapping[int, Mesh] | None = None,
    ) -> None:
        self._models, self._settings, self._meshes = models, settings, dict(meshes or {})
        self._scorers: dict[int, _ObjectScorer] = {}
        self._estimates: dict[tuple[int, int, int], list[PoseEstimate]] = {}
        for estimate in estimates:
            _check_finite(estimate)
            key = (estimate.scene_id, estimate.frame_id, estimate.object_id)
            self._estimates.setdefault(key, []).append(estimate)

    def score(self, truth: FrameTruth) -> list[TargetScore]:
        """One score for each target of a frame, object by object.

        Raises DataError for a target whose object has no model.
        """
        scores = []
        depth = None if truth.depth is None else truth.depth.unpack()
        for object_id in dict.fromkeys(target.object_id for target in truth.targets):
            found = self._estimates.get((truth.scene_id, truth.frame_id, object_id), [])
            scores += self._scorer(object_id).score(truth, depth, found)
        return scores

    def _scorer(self, object_id: int) -> "_ObjectScorer":
        if object_id not in self._models:
            raise DataError(f"targets ask for object {object_id}, which has no model")
        if object_id not in self._scorers:
            model = self._models[object_id]
            mesh = self._meshes.get(object_id, model.mesh)
            self._scorers[object_id] = _ObjectScorer(model, self._settings, mesh)
        return self._scorers[object_id]


def add_correct(
    poses_cam_obj: Float[np.ndarray, "n 4 4"],
    true_pose: Float[np.ndarray, "4 4"],
    model: ObjectModel,
    settings: EvaluationSettings,
) -> Bool[np.ndarray, "n"]:
    """Verdict of ADD(-S) on many poses of one target, by the same policy as `score_targets`."""
    scorer = _ObjectScorer(model, settings, model.mesh)
    distances = np.array([scorer.add_error(pose, true_pose) for pose in poses_cam_obj])
    return distances < scorer.add_limit


class _ObjectScorer:
    """Scores the targets of one object; keeps what its errors need more than once."""

    def __init__(self, model: ObjectModel, settings: EvaluationSettings, bop_mesh: Mesh) -> None:
        self._model, self._settings = model, settings
        self._vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
        self.add_limit = settings.add_fraction * model.diameter
        self._symmetric = settings.is_symmetric(model)
        self._tree = cKDTree(self._vertices) if self._symmetric else None
        self._few_vertices = self._vertices[:: max(1, len(self._vertices) // _FEW_VERTICES)]
        self._few_tree = cKDTree(self._few_vertices)
        self._bop_mesh = bop_mesh

    @cached_property
    def _bop_recalls(self) -> BopRecalls:
        return BopRecalls(self._model, self._bop_mesh)

    def score(
        self,
        truth: FrameTruth,
        depth: Float[np.ndarray, "h w"] | None,
        estimates: Sequence[PoseEstimate],
    ) -> list[TargetScore]:
        """Scores of all targets of this object in one frame."""
        targets = [t for t in truth.targets if t.object_id == self._model.object_id]
        surest = sorted(estimates, key=lambda estimate: -estimate.score)
        found = [(e.pose_cam_obj, e.score) for e in surest if e.pose_cam_obj is not None]
        true_poses = [target.pose_cam_obj for target in targets]
        found = found[: len(targets)]
        poses = [pose for pose, _ in found]
        recalls = self._bop_recalls.of(true_poses, poses, truth.camera_matrix, truth.width, depth)
        matched = self._match(true_poses, poses)
        return [
            missed_score(
                truth.scene_id,
                truth.frame_id,
                (target.object_id, target.visible_fraction),
                (float(recall[0]), float(recall[1]), float(recall[2])),
            )
            if row is None
            else self._score(truth, target, *found[row], recall)
            for target, row, recall in zip(targets, matched, recalls, strict=True)
        ]

    def _match(self, true_poses: Sequence[Pose], poses: Sequence[Pose]) -> list[int | None]:
        """Index of the pose matched to each true pose; right poses are matched first."""
        matched: list[int | None] = [None] * len(true_poses)
        if len(true_poses) == 1:
            return [0] if poses else matched
        errors_of = [[self.add_error(pose, true) for true in true_poses] for pose in poses]
        left = list(range(len(poses)))
        for limit in (self.add_limit, np.inf):
            for i in tuple(left):
                near = [
                    j for j, each in enumerate(matched) if each is None and errors_of[i][j] < limit
                ]
                if near:
                    matched[min(near, key=lambda j: errors_of[i][j])] = i
                    left.remove(i)
        return matched

    def add_error(self, estimated: Pose, true: Pose) -> float:
        """ADD(-S) in metres: ADD-S where the policy calls the object symmetric, else ADD."""
        if self._symmetric:
            return errors.add_s(estimated, true, self._vertices, self._tree)
        return errors.add(estimated, true, self._vertices)

    def _add_s(self, estimated: Pose, true: Pose) -> float:
        """ADD-S (m) over about 2000 of the vertices."""
        return errors.add_s(estimated, true, self._few_vertices, self._few_tree)

    def _score(
        self,
        truth: FrameTruth,
        target: Target,
        pose: Pose,
        score: float,
        recalls: Float[np.ndarray, "3"],
    ) -> TargetScore:
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
            vsd_recall=float(recalls[0]),
            mssd_recall=float(recalls[1]),
            mspd_recall=float(recalls[2]),
            score=score,
            add_s_correct=self._add_s(pose, true) < self.add_limit,
        )


def _check_finite(estimate: PoseEstimate) -> None:
    pose = estimate.pose_cam_obj
    if pose is not None and not np.isfinite(pose).all():
        raise ValueError(
            f"the estimate of object {estimate.object_id} in scene {estimate.scene_id}, frame"
            f" {estimate.frame_id} holds NaN or infinity"
        )
