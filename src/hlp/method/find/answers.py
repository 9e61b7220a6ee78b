"""The answers of an object without colours, and the scores that they have once all are chosen."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hlp.arrays import Points, Pose, Poses
from hlp.method.find.estimator import FrameContext
from hlp.refinement.appearance import BEST_OF_MANY, PartAppearance, likeness_evidence
from hlp.refinement.arrangement import rival_poses
from hlp.refinement.score_model import PRESENT, logits_of

_LOOK = 0.3
"""Weight of what the look tells, in the end, of answers of a known number: it chose them (D)."""
_KNOWN = 0.2
"""Added to the logit, in the end, of answers of a known number (D)."""
_RIVAL = 1.5
"""Weight of the logarithm of the probability that a rival of an answer is wrong (D)."""


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

    `samples` (m) are of its surface, `known` says whether the number of its instances is.
    """

    context: FrameContext
    object_id: int
    answers: Sequence[Answer]
    looks: Mapping[int, PartAppearance]
    samples: Points
    known: bool

    def settle(self, others: Poses, divided: Sequence[Pose]) -> None:
        """Give the answers the appearance that they have in the end (`FrameFits.settle`).

        `others` are poses that were not chosen. Those that were `divided` into answers, or are the
        same as another answer, exclude none.
        """
        told, fits = np.array([self._told(answer) for answer in self.answers]), self.context.fits
        poses = [answer.pose for answer in self.answers]
        for row, pose in enumerate(poses):
            elsewhere = [*poses[:row], *poses[row + 1 :], *divided]
            told[row] += self._rival_evidence(pose, others, np.reshape(elsewhere, (-1, 4, 4)))
        if self.known:
            alone = [fits.score_alone(self.object_id, pose) for pose in poses]
            shares = np.stack([self.looks[answer.row].shares for answer in self.answers])
            told += likeness_evidence(shares, logits_of(np.array(alone)) + told + PRESENT)
        for pose, appearance in zip(poses, told, strict=True):
            fits.set_settled(self.object_id, pose, float(appearance))

    def _told(self, answer: Answer) -> float:
        if self.known:
            return _KNOWN + _LOOK * answer.look + answer.more + answer.neighbours
        return BEST_OF_MANY + answer.look + answer.more + answer.neighbours

    def _rival_evidence(self, pose: Pose, others: Poses, elsewhere: Poses) -> float:
        """Log-likelihood ratio of right against wrong that other poses at the same place tell.

        Of poses that exclude each other, one is less likely, the likelier the others are.
        """
        of = self.context.estimator.verifier(self.object_id), self.context.observation, pose
        rivals = rival_poses(*of, others, elsewhere, self.samples)
        scores: list[float] = [self.context.fits.score_alone(self.object_id, one) for one in rivals]
        return _RIVAL * float(np.log(max(1.0 - max(scores, default=0.0), 1e-9)))
