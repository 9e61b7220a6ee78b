"""What one search after another finds of an object in a frame, and which of it are instances."""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from hlp.arrays import Pose, Poses
from hlp.geometry import transform
from hlp.method.find.answers import Answer, Chosen, arrangement_evidence, stand_side_by_side
from hlp.method.find.estimator import FrameContext
from hlp.method.find.frame_fits import Unexplained
from hlp.method.find.related_poses import poses_beside, poses_within
from hlp.records import Hypotheses
from hlp.refinement.appearance import BEST_OF_MANY, FrameColors, PartAppearance, appearance_evidence
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.score_model import MIN_SCORE, logits_of, once_evidence
from hlp.refinement.verification import Observation

CoarsePoses = Callable[[int, Observation | None], Hypotheses]
"""Coarse poses for a number of missing instances, given what is unexplained."""
_AT_PLACES = 4
"""Hypotheses refined for an instance after the first look: later ones are rarely right (D).

Votes for parts without colours rank worse, so those keep as many as in the first look.
"""
_TRIED = 3
"""Instances that are refined at once where their number is not known (D)."""
_POSSIBLE = 0.01
"""Score of a pose that no search chose, but that may turn out to be right: others never do (D)."""
_LIKELY = 0.3
"""Score of a pose beside which others of its kind are looked for (D)."""
_VERY_LIKELY = 0.9
"""Score of a pose beside which they are looked for in the place of less likely ones, too (D)."""
_PART_OF = 0.05
"""If the best of several parts scores less, as a share of the one they were taken for, it is one.

Their edges tell more than their fit, unless they do not fit at all (D).
"""


class Attempts:
    """What each search of a part of the frame has found, the region being the first part.

    Parts without a coloured model are often packed, and one alone is hard to tell from a half of
    two others. So several of them help to find each other: by places of neighbours, and by colour.
    """

    def __init__(
        self,
        context: FrameContext,
        object_id: int,
        instances: int,
        unexplained: Observation | None,
        min_score: float | None,
    ) -> None:
        self._estimator, self._context, self._object_id = context.estimator, context, object_id
        self._instances, self._unexplained, self._min_score = instances, unexplained, min_score
        self._of, self._verifier = (context, object_id), context.estimator.verifier(object_id)
        self._right = max(MIN_SCORE, min_score or 0.0)
        self._colorless = context.estimator.has_templates(object_id)
        self._help_each_other = instances > 1 and self._colorless
        self._found: list[RefinedHypotheses] = []
        self._answers: list[Answer] = []
        self._searched_beside: set[tuple[float, bytes]] = set()
        self._looked_within: set[bytes] = set()
        self._appearances: dict[int, PartAppearance] = {}
        self._kept: list[Answer] | None = None  # of the answers, until there are others

    @cached_property
    def _colors(self) -> FrameColors:
        model, observation = self._verifier.model, self._context.observation
        distance = float(transform(self._answers[0].pose, model.centroid[None])[0, 2])
        size = observation.camera_matrix[0, 0] * model.diameter / distance
        return FrameColors.of(self._context.frame.rgb, self._context.color_edges(), model, size)

    def add(self, found: RefinedHypotheses | None) -> None:
        """Add what the next search found."""
        if found is None:
            return
        start = sum(len(before.refined) for before in self._found)
        self._found.append(found)
        self._kept = None
        scores = [self._score(pose) for pose in found.chosen_poses]
        many = self._colorless and (self._min_score is None or max(scores) >= self._right)
        for row in range(len(found.refined)) if many else found.instances:
            pose, chosen = found.refined[row].pose_cam_obj, row in found.instances
            if found.refined[row].given_up and not chosen:
                continue  # hardly ever scores `_POSSIBLE`, and scoring takes long
            if (score := self._score(pose)) >= _POSSIBLE or chosen:
                self._answers.append(Answer(score, start + row, pose, chosen))

    def search_further(self, coarse_poses: CoarsePoses, known: Sequence[Pose]) -> None:
        """Refine coarse poses of the missing instances, in what the `known` ones leave."""
        rest = self._rest()
        for pose in known:
            rest.take(self._object_id, pose)
        missing, enough = self._instances - len(known), self._min_score
        candidates = None if self._colorless else _AT_PLACES
        coarse = coarse_poses(missing, rest.left)
        if self._colorless and enough is not None:
            # What looks best may be the bin: some more are tried, whatever the score of the first.
            missing, enough = min(missing, _TRIED), None
        found = self._estimator.refine(*self._of, coarse, missing, rest.left, enough, candidates)
        self.add(found and found.from_elsewhere())

    def search_neighbours(self, least: float = _LIKELY) -> None:
        """Search the neighbours of what was found, and theirs, until there are no more.

        They are those of answers that score `least`, wherever no such answer stands. Before, what
        was taken for one part and is several is divided.
        """
        while self._help_each_other:
            self._divide()
            found, searched = self.poses(least), self._searched_beside
            new = [pose for pose in found if (least, pose.tobytes()) not in searched]
            if len(found) >= self._instances or not new:
                break
            self._searched_beside |= {(least, pose.tobytes()) for pose in new}
            seen = self._verifier, self._context.observation
            coarse = poses_beside(*seen, np.stack(new), np.stack(self.poses(0.0)))
            self.search_further(lambda *_, coarse=coarse: coarse, found)

    def _divide(self) -> None:
        """Put several parts in the place of each answer that has edges where they would touch."""
        looked = self._looked_within  # and its parts, which are no further divided
        while new := [a for a in self._different() if a.pose.tobytes() not in looked]:
            answer = new[0]
            looked.add(answer.pose.tobytes())
            within = poses_within(self._verifier, self._context.observation, answer.pose)
            parts = [part for poses in within if (part := self._refined_alone(poses))]
            found = [part.chosen_poses[0] for part in parts]
            best = max((self._score(pose) for pose in found), default=0.0)
            if len(parts) == len(within) > 0 and best >= _PART_OF * self._score(answer.pose):
                looked |= {pose.tobytes() for pose in found}
                self._replace(answer, parts)

    def _refined_alone(self, poses: Poses) -> RefinedHypotheses | None:
        """What is found by refining coarse poses of one instance, whatever else was found."""
        coarse = Hypotheses(poses, np.ones(len(poses)))
        return self._estimator.refine(*self._of, coarse, 1, self._unexplained)

    def _replace(self, answer: Answer, parts: Sequence[RefinedHypotheses]) -> None:
        """Take the chosen pose of each part instead of an answer.

        It is as likely as that was, at least: that something of the kind is there remains true.
        """
        self._kept = None
        self._answers = [other for other in self._answers if other.row != answer.row]
        before = self._score(answer.pose)
        for part in parts:
            row = sum(len(others.refined) for others in self._found) + part.instances[0]
            self._found.append(part.from_elsewhere())
            (pose,) = part.chosen_poses
            scores = np.array([self._score(pose), before])
            more = max(float(np.diff(logits_of(scores))[0]), 0.0)
            self._answers.append(Answer(float(scores.max()), row, pose, answer.chosen, more))

    def search_rest(self, coarse_poses: CoarsePoses, known: Sequence[Pose]) -> None:
        """Search what is left, again and again, while more than before is probably right."""
        while len(known) < len(found := self.poses(self._right)) < self._instances:
            self.search_further(coarse_poses, known := found)
            self.search_neighbours()

    def search_instead(self) -> None:
        """Search beside sure ones in the place of less sure ones, too.

        Where the number of instances is not known, as many wrong answers as right ones would gain
        by it.
        """
        if self._min_score is None:
            self.search_neighbours(_VERY_LIKELY)
            self.search_neighbours()
        if self._help_each_other:
            self._divide()  # what came forward where others changed
        if self._colorless:
            self._turn_over()

    def _turn_over(self) -> None:
        """Turn over the likely answers that were found upside down or end for end."""
        for answer in self._different():
            if answer.score < _LIKELY:
                continue
            if (turned := self._estimator.turn_over(*self._of, answer.pose)) is not None:
                self._replace(answer, [turned])

    def poses(self, least: float) -> list[Pose]:
        """Those of at least that score, each of another instance, the most likely first."""
        if not self._colorless and all(answer.score < least for answer in self._answers):
            return []  # scores of objects without colours depend on other answers
        return [answer.pose for answer in self._different() if answer.score >= least]

    def merged(self) -> RefinedHypotheses | None:
        """All attempts as one: the best answers, each of another instance.

        Scores of objects without colours are settled.
        """
        if not self._found:
            return None
        if len(self._found) == 1 and not self._colorless:
            return self._found[0]
        refined = [pose for found in self._found for pose in found.refined]
        kept = self._different()
        rows = tuple(answer.row for answer in kept)
        if self._colorless:
            Chosen(*self._of, kept, self._appearances, self._min_score is None).settle()
        return RefinedHypotheses(
            refined,
            np.concatenate([found.costs for found in self._found]),
            np.concatenate([found.sources for found in self._found]),
            np.concatenate([found.starts for found in self._found]),
            rows,
        )

    def _different(self) -> list[Answer]:
        """The most likely answers, without those on pixels of better ones.

        What a search chose, and is likely, goes before what is only less unlikely.
        """
        if self._kept is None:
            judged = self._judge() if self._colorless else self._answers
            judged = sorted(judged, key=lambda a: (not (a.chosen and a.score >= _LIKELY), -a.score))
            self._kept = self._apart(judged)
        return self._kept

    def _judge(self) -> list[Answer]:
        """All answers, with scores that know where the surest ones stand and how they look."""
        if not self._answers:
            return []
        best_first = sorted(self._answers, key=lambda answer: -answer.score)
        rows = {answer.row for answer in self._apart(best_first) if answer.score >= MIN_SCORE}
        sure = np.array([answer.row in rows for answer in self._answers])
        new = [answer for answer in self._answers if answer.row not in self._appearances]
        seen = self._verifier, self._context.observation
        self._appearances |= {answer.row: self._colors.at(*seen, answer.pose) for answer in new}
        appearances = [self._appearances[answer.row] for answer in self._answers]
        logits = logits_of(np.array([answer.score for answer in self._answers]))
        look = appearance_evidence(appearances, logits, sure, self._colors)
        poses, known = np.stack([a.pose for a in self._answers]), self._min_score is None
        beside = stand_side_by_side(self._verifier.model, poses) & self._help_each_other
        neighbours = arrangement_evidence(beside, logits + look, sure, known)
        told = zip(self._answers, look.tolist(), neighbours.tolist(), strict=True)
        return [
            answer._replace(
                score=self._score(answer.pose, BEST_OF_MANY + own + answer.more + others),
                look=own,
                neighbours=others,
            )
            for answer, own, others in told
        ]

    def _score(self, pose: Pose, appearance: float = BEST_OF_MANY) -> float:
        fits, of = self._context.fits, (self._object_id, pose)
        if self._colorless:
            once = self._instances == 1 and self._min_score is None
            more = once_evidence(fits.measure(*of)) if once else 0.0
            fits.set_appearance(*of, appearance + more)
        return fits.score(*of)

    def _rest(self) -> Unexplained:
        seen = self._context.observation
        return Unexplained(seen, self._estimator.verifier, self._unexplained)

    def _apart(self, answers: Sequence[Answer]) -> list[Answer]:
        """Those of the answers, the best first, that do not stand on pixels of better ones."""
        kept: list[Answer] = []
        rest = self._rest()
        for answer in answers:
            if len(kept) == self._instances:
                break
            if not kept or rest.is_free(self._object_id, answer.pose):
                kept.append(answer)
                rest.take(self._object_id, answer.pose)
        return kept
