"""BOP's average precision: detection of objects in images whose content is not known beforehand.

It agrees with the BOP toolkit's eval_bop24_pose: the curve of precision by recall, made to fall, is
read at 101 recalls as in COCO, and averaged over the limits of an error, then over objects.
Instances that are hardly visible count neither as found nor as missed, nor does what is matched to
them count as wrong. Nor does an answer for an object that the image does not show: the toolkit asks
the truth what to look at. Such answers are false alarms, which are counted apart.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hlp.arrays import Pose, Values, grouped
from hlp.evaluation.bop_recalls import FRACTIONS, PIXELS, WIDTH, BopRecalls, match
from hlp.evaluation.evaluator import FrameTruth
from hlp.records import Mesh, ObjectModel, PoseEstimate

MOST_ANSWERS = 100
"""Answers of one image that count, those of the highest scores."""
LEAST_VISIBLE = 0.1
"""Visible fraction below which an instance is ignored."""
LENGTHS = np.arange(2, 21, 2) * 1e-3
"""Limits of MSSD in metres (BOP Challenge 2025)."""
_RECALLS = np.linspace(0.0, 1.0, 101)
_NAMES = ("mssd", "mspd", "mssd_mm")


class _Answers(NamedTuple):
    """Answers for one object in one frame: scores, and for each error's limits the verdicts.

    `right` and `counted` are (errors, answers, limits); what is not counted is ignored.
    """

    scores: Values
    right: Bool[np.ndarray, "e m k"]
    counted: Bool[np.ndarray, "e m k"]


def average_precision(
    truths: Iterable[FrameTruth],
    models: Mapping[int, ObjectModel],
    estimates: Iterable[PoseEstimate],
    meshes: Mapping[int, Mesh] | None = None,
) -> dict[str, float | None]:
    """Average precision over objects: `ap`, the mean of `mssd` and `mspd`; and `mssd_mm`.

    `truths` have all instances of an image as targets; images without one count, too. `estimates`
    are all answers in them. `meshes` are those on which errors are measured; by default and for
    objects that are not named the models' own. None without any instance that counts.
    """
    surest = sorted((e for e in estimates if e.pose_cam_obj is not None), key=lambda e: -e.score)
    answers = grouped(surest, lambda e: (e.scene_id, e.frame_id))
    found: dict[int, list[_Answers]] = {object_id: [] for object_id in models}
    instances = dict.fromkeys(models, 0)
    given = meshes or {}
    measures = {i: BopRecalls(model, given.get(i, model.mesh)) for i, model in models.items()}
    for truth in truths:
        own = answers.get((truth.scene_id, truth.frame_id), [])[:MOST_ANSWERS]
        for object_id, model in models.items():
            targets = [target for target in truth.targets if target.object_id == object_id]
            ignored = np.array([t.visible_fraction < LEAST_VISIBLE for t in targets], dtype=bool)
            instances[object_id] += int((~ignored).sum())
            of_object = (e for e in own if e.object_id == object_id)
            poses = [(e.score, e.pose_cam_obj) for e in of_object if e.pose_cam_obj is not None]
            if poses and targets:
                measure = measures[object_id], model.diameter
                true = [target.pose_cam_obj for target in targets]
                found[object_id].append(_judge(truth, *measure, true, ignored, poses))
    curves = [_precisions(found[i], count) for i, count in instances.items() if count]
    if not curves:
        return dict.fromkeys(("ap", *_NAMES))
    means = np.mean(curves, axis=0)
    return {"ap": float(means[:2].mean()), **dict(zip(_NAMES, means.tolist(), strict=True))}


def _judge(
    truth: FrameTruth,
    measure: BopRecalls,
    diameter: float,
    true_poses: Sequence[Pose],
    ignored: Bool[np.ndarray, "n"],
    answers: Sequence[tuple[float, Pose]],
) -> _Answers:
    """The verdicts on an object's answers in one frame."""
    mssd, mspd = measure.distances(true_poses, [pose for _, pose in answers], truth.camera_matrix)
    limits = FRACTIONS * diameter, PIXELS * truth.width / WIDTH, LENGTHS
    errors = zip((mssd, mspd, mssd), limits, strict=True)
    matched = np.stack([match(error[..., None], own)[:, 0] for error, own in errors])
    # Row -1 of the instances stands for none.
    hidden = np.append(ignored, False)[matched]
    scores = np.array([score for score, _ in answers], dtype=np.float64)
    return _Answers(scores, (matched >= 0) & ~hidden, ~hidden)


def _precisions(answers: Sequence[_Answers], instances: int) -> Float[np.ndarray, "e"]:
    """Average precision of one object by each error, averaged over the limits."""
    if not answers:
        return np.zeros(len(_NAMES))
    order = np.argsort(-np.concatenate([own.scores for own in answers]), kind="stable")
    right = np.concatenate([own.right for own in answers], axis=1)[:, order]
    counted = np.concatenate([own.counted for own in answers], axis=1)[:, order]
    hits, total = right.cumsum(axis=1), counted.cumsum(axis=1)
    precision = np.divide(hits, total, out=np.zeros(hits.shape), where=total > 0)
    falling = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    curve = np.concatenate([falling, np.zeros_like(falling[:, :1])], axis=1)
    shares = np.zeros(hits.shape[::2])
    for e, k in np.ndindex(shares.shape):
        first = np.searchsorted(hits[e, :, k] / instances, _RECALLS)
        shares[e, k] = curve[e, first, k].mean()
    return np.asarray(shares.mean(axis=1))
