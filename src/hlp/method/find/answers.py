"""What the answers of an object without colours tell of each other, and their scores in the end.

Parts are often packed in rows, or stacked. A wrong answer hardly ever touches a right one, face to
face and turned as it is; a right one does where parts are packed. Where most of a frame's parts
stand like that, one that does not is less likely right. So is one in other colours than the rest.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hlp.arrays import Flags, Pose, Poses, Values
from hlp.geometry import transform
from hlp.method.find.estimator import FrameContext
from hlp.records import ObjectModel
from hlp.refinement.appearance import BEST_OF_MANY, PartAppearance
from hlp.refinement.score_model import PRESENT, logits_of, probabilities, worse_than_others

_SAME_TURN = np.radians(15.0)
_MISFIT = 0.2  # of the part's size along each of its axes (D)
_BY_CHANCE = 0.05  # probability that a wrong answer stands beside a right one (D)
_MOST = 0.95  # of the share of right answers that do
_ROUNDS = 2  # in which answers tell each other which are right
_LIKENESS = 0.88  # likeness (Bhattacharyya) of colours that tells nothing: light differs (D)
_UNLIKE = 9.0  # of the logit, for each unit of likeness (D)
_PAINTED = -3.0, 1.0  # of it: a part may have another paint than the others (D)
_USUAL = 0.03  # difference in cost and edge between parts, where some may be other things (D)
_OTHERS = 1.0, 3.0  # others, by the sum of their probabilities: that tell nothing, and all (D)
_LOOK = 0.3
"""Weight of what the look tells, in the end, of answers of a known number: it chose them (D)."""
_KNOWN = 0.2
"""Added to the logit, in the end, of answers of a known number (D)."""


class Answer(NamedTuple):
    """A refined pose, its row among all of them, and whether a search chose it as an instance.

    To the logit of its score are added `more`, for what it stands in the place of, what its `look`
    tells, and what its `neighbours` tell.
    """

    score: float
    row: int
    pose: Pose
    chosen: bool
    more: float = 0.0
    look: float = 0.0
    neighbours: float = 0.0


class Chosen(NamedTuple):
    """Answers of one object in a frame, each of another instance, and their looks by their rows.

    `known` says whether the number of its instances is.
    """

    context: FrameContext
    object_id: int
    answers: Sequence[Answer]
    looks: Mapping[int, PartAppearance]
    known: bool

    def settle(self) -> None:
        """Give the answers the appearance that they have in the end (`FrameFits.settle`)."""
        told, fits = np.array([self._told(answer) for answer in self.answers]), self.context.fits
        poses = [answer.pose for answer in self.answers]
        alone = [fits.score_alone(self.object_id, pose) for pose in poses]
        logits = logits_of(np.array(alone)) + told
        if self.known:
            shares = np.stack([self.looks[answer.row].shares for answer in self.answers])
            told += likeness_evidence(shares, logits + PRESENT)
        else:  # some may be other things; `ScoreModel.scores` compares those of a known number
            measured = [fits.measure(self.object_id, pose) for pose in poses]
            told -= worse_than_others(measured, probabilities(logits), _USUAL)
        for pose, appearance in zip(poses, told, strict=True):
            fits.set_settled(self.object_id, pose, float(appearance))

    def _told(self, answer: Answer) -> float:
        if self.known:
            return _KNOWN + _LOOK * answer.look + answer.more + answer.neighbours
        return BEST_OF_MANY + answer.look + answer.more + answer.neighbours


def stand_side_by_side(model: ObjectModel, poses_cam_obj: Poses) -> Bool[np.ndarray, "n n"]:
    """Which poses are turned alike, and one size of the part apart along one of its axes.

    The size is that of its bounding box. Symmetries are no turns.
    """
    rotations, count = poses_cam_obj[:, :3, :3], len(poses_cam_obj)
    equal = (rotations[:, None] @ model.symmetries[:, :3, :3]).reshape(-1, 9)
    traces = (equal @ rotations.reshape(-1, 9).T).reshape(count, -1, count).max(axis=1)
    alike = traces >= 1.0 + 2.0 * np.cos(_SAME_TURN)
    centers = transform(poses_cam_obj, model.centroid[None])[:, 0]
    apart = np.einsum("nkm,nlk->nlm", rotations, centers[None] - centers[:, None])
    apart = np.abs(apart) / np.maximum(np.ptp(model.proxy.vertices, axis=0), 1e-6)
    one = apart > 0.5
    beside = (np.abs(apart - one) < _MISFIT).all(axis=-1) & (one.sum(axis=-1) == 1)
    return np.asarray(alike & beside)


def arrangement_evidence(
    beside: Bool[np.ndarray, "n n"], logits: Values, sure: Flags, known: bool
) -> Values:
    """Log-likelihood ratio of right against wrong that each answer's neighbours tell.

    `beside` says which answers stand side by side, `logits` are those of their scores. How many of
    the right ones have a neighbour follows from the `sure` ones; none speaks for itself. Where the
    number of instances is not `known`, wrong ones, too, may touch: an answer then tells as far as
    it is likelier right than wrong before it has neighbours.
    """
    evidence = np.zeros(len(logits))
    for _ in range(_ROUNDS if known else 1):
        right = probabilities(logits + evidence)
        telling = right if known else np.maximum(2.0 * right - 1.0, 0.0)
        neighbour = np.where(beside, telling, 0.0).max(axis=1)
        weights = np.where(sure, right, 0.0)
        found = (weights * neighbour).sum() - weights * neighbour
        share = (found + _BY_CHANCE) / (weights.sum() - weights + 1.0)
        share = np.clip(share, _BY_CHANCE, _MOST)
        if_right = neighbour * share + (1.0 - neighbour) * (1.0 - share)
        if_wrong = neighbour * _BY_CHANCE + (1.0 - neighbour) * (1.0 - _BY_CHANCE)
        evidence = np.log(if_right / if_wrong)
    return evidence


def likeness_evidence(shares: Float[np.ndarray, "n 864"], logits: Values) -> Values:
    """Log-likelihood ratio of how alike each answer's colours are to those of all the others.

    Those of answers that were chosen: they differ in place, and nothing was chosen by it. The
    others count by the probability of their `logits`. One other alone may be another side, in
    another light.
    """
    right = probabilities(logits)
    weights = np.where(np.eye(len(right), dtype=bool), 0.0, right[:, None])
    others = weights.sum(axis=0)
    part = weights.T @ shares / np.maximum(others, 1e-9)[:, None]
    alike = np.sqrt(part * shares).sum(axis=1)  # 1: the same colours, as often
    least, all_ = _OTHERS
    told = np.clip((others - least) / (all_ - least), 0.0, 1.0) * shares.any(axis=1)
    return np.asarray(told * np.clip(_UNLIKE * (alike - _LIKENESS), *_PAINTED))
