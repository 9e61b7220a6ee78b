"""Scores estimates against the true poses: errors and verdicts of each target (paper, Sec. 4).

Recall counts targets. A target without an estimate is wrong. Estimates of objects that are no
target, or beyond the number of targets, are ignored.
"""

import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from hlp.arrays import CameraMatrix, Flags, Image, Pose, Poses, grouped
from hlp.errors import DataError
from hlp.evaluation import EvaluationSettings, errors
from hlp.evaluation.bop_recalls import BopRecalls
from hlp.geometry import nearest_symmetric_pose
from hlp.records import Frame, Mesh, ObjectModel, PoseEstimate, Target, TargetScore

_FEW_VERTICES = 2000


@dataclass(frozen=True)
class FrameTruth:
    """The part of a frame that scoring needs.

    `packed_depth`, only where VSD is wanted, is the depth image compressed without loss to about an
    eighth, so that those of many frames can be kept.
    """

    scene_id: int
    frame_id: int
    camera_matrix: CameraMatrix
    width: int
    targets: tuple[Target, ...]
    packed_depth: bytes | None = None

    @classmethod
    def of(cls, frame: Frame, with_depth: bool = False) -> "FrameTruth":
        """Take from a frame what scoring needs."""
        ids, packed = (frame.scene_id, frame.frame_id), None
        if with_depth:
            single = np.ascontiguousarray(frame.depth, dtype=np.float32)
            packed = zlib.compress(single.tobytes(), level=1)
        return cls(*ids, frame.camera_matrix, frame.rgb.shape[1], frame.targets, packed)

    def unpacked_depth(self) -> Image | None:
        """The depth image (m)."""
        if self.packed_depth is None:
            return None
        return np.frombuffer(zlib.decompress(self.packed_depth), np.float32).reshape(-1, self.width)


def score_targets(
    truths: Iterable[FrameTruth],
    models: Mapping[int, ObjectModel],
    estimates: Iterable[PoseEstimate],
    settings: EvaluationSettings,
    meshes: Mapping[int, Mesh] | None = None,
    vsd_delta: float = errors.VSD_DELTA,
) -> list[TargetScore]:
    """One score for each target of the frames, frame by frame and object by object.

    `estimates` are those of all frames. `meshes` are those on which BOP's errors are measured; by
    default and for objects that are not named the models' own. `vsd_delta` (m) is that of VSD.

    Of an object with n targets in a frame, the n estimates with the highest scores count. In that
    order, each is matched to the free target with the smallest ADD(-S), first those that are right,
    then the others. BOP's errors are matched by the same rule for each threshold. A target without
    an estimate, or whose estimate has no pose, is wrong with infinite errors. Raises DataError for
    a target whose object has no model.
    """
    found = grouped(estimates, lambda e: (e.scene_id, e.frame_id, e.object_id))
    scorers: dict[int, _ObjectScorer] = {}
    scores = []
    for truth in truths:
        depth = truth.unpacked_depth()
        for object_id in dict.fromkeys(target.object_id for target in truth.targets):
            if object_id not in models:
                raise DataError(f"targets ask for object {object_id}, which has no model")
            if object_id not in scorers:
                bop_mesh = (meshes or {}).get(object_id, models[object_id].mesh)
                scorers[object_id] = _ObjectScorer(models[object_id], settings, bop_mesh, vsd_delta)
            own = found.get((truth.scene_id, truth.frame_id, object_id), [])
            scores += scorers[object_id].score(truth, depth, own)
    return scores


def add_correct(
    poses_cam_obj: Poses, true_pose: Pose, model: ObjectModel, settings: EvaluationSettings
) -> Flags:
    """Verdict of ADD(-S) on many poses of one target, by the same policy as `score_targets`."""
    scorer = _ObjectScorer(model, settings, model.mesh, errors.VSD_DELTA)
    distances = np.array([scorer.add_error(pose, true_pose) for pose in poses_cam_obj])
    return distances < scorer.add_limit


class _ObjectScorer:
    """Scores the targets of one object; keeps what its errors need more than once."""

    def __init__(
        self, model: ObjectModel, settings: EvaluationSettings, bop_mesh: Mesh, vsd_delta: float
    ) -> None:
        self._model, self._settings = model, settings
        self._of_bop = model, bop_mesh, vsd_delta
        self._vertices = np.asarray(model.mesh.vertices, dtype=np.float64)
        self.add_limit = settings.add_fraction * model.diameter
        self._symmetric = settings.is_symmetric(model)
        self._tree = cKDTree(self._vertices) if self._symmetric else None
        self._few_vertices = self._vertices[:: max(1, len(self._vertices) // _FEW_VERTICES)]
        self._few_tree = cKDTree(self._few_vertices)

    @cached_property
    def _bop_recalls(self) -> BopRecalls:
        return BopRecalls(*self._of_bop)

    def score(
        self, truth: FrameTruth, depth: Image | None, estimates: Sequence[PoseEstimate]
    ) -> list[TargetScore]:
        """Scores of all targets of this object in one frame."""
        targets = [t for t in truth.targets if t.object_id == self._model.object_id]
        true_poses = [target.pose_cam_obj for target in targets]
        surest = sorted(estimates, key=lambda estimate: -estimate.score)
        found = [(e.pose_cam_obj, e.score) for e in surest if e.pose_cam_obj is not None]
        found = found[: len(targets)]
        poses = [pose for pose, _ in found]
        recalls = self._bop_recalls.of(true_poses, poses, truth.camera_matrix, truth.width, depth)
        matched = self._match(true_poses, poses)
        scores = []
        for target, row, (vsd, mssd, mspd) in zip(targets, matched, recalls.tolist(), strict=True):
            score = TargetScore(
                truth.scene_id,
                truth.frame_id,
                target.object_id,
                found=False,
                visible_fraction=target.visible_fraction,
                mssd_recall=mssd,
                mspd_recall=mspd,
                vsd_recall=vsd,
            )
            if row is not None:
                score = self._found(score, target.pose_cam_obj, *found[row], truth.camera_matrix)
            scores.append(score)
        return scores

    def _match(self, true_poses: Sequence[Pose], poses: Sequence[Pose]) -> list[int | None]:
        """Row of the pose matched to each true pose; right poses are matched first."""
        if len(true_poses) == 1:
            return [0 if poses else None]
        distances = [[self.add_error(pose, true) for true in true_poses] for pose in poses]
        matched: dict[int, int] = {}
        for limit in (self.add_limit, np.inf):
            for row, own in enumerate(distances):
                near = [i for i, d in enumerate(own) if i not in matched and d < limit]
                if near and row not in matched.values():
                    matched[min(near, key=own.__getitem__)] = row
        return [matched.get(i) for i in range(len(true_poses))]

    def add_error(self, estimated: Pose, true: Pose) -> float:
        """ADD(-S) in metres: ADD-S where the policy calls the object symmetric, else ADD."""
        if self._symmetric:
            return errors.add_s(estimated, true, self._vertices, self._tree)
        return errors.add(estimated, true, self._vertices)

    def _found(
        self, missed: TargetScore, true: Pose, pose: Pose, score: float, camera: CameraMatrix
    ) -> TargetScore:
        """The score of a target that got a pose, of that score, from the one without."""
        settings = self._settings
        alike = true
        if self._symmetric:
            alike = nearest_symmetric_pose(pose, true, self._model.symmetries)
        add_error = self.add_error(pose, true)
        add_s_error = errors.add_s(pose, true, self._few_vertices, self._few_tree)
        turn, shift = errors.rotation_error(pose, alike), errors.translation_error(pose, alike)
        iou = errors.box_iou(pose, true, self._vertices, camera)
        near = shift < settings.translation_cm * 1e-2
        return replace(
            missed,
            found=True,
            add_error=add_error,
            rotation_error=turn,
            translation_error=shift,
            box_iou=iou,
            add_correct=add_error < self.add_limit,
            pose_correct=near and turn < math.radians(settings.rotation_deg),
            box_correct=iou >= settings.iou,
            score=score,
            add_s_correct=add_s_error < self.add_limit,
        )
