"""One object's instances: the whole region first, then its likeliest places."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hlp.method.find.instances import find_instances
from hlp.records import Hypotheses, Refinement, Region
from hlp.refinement.choice import RefinedHypotheses

REGION = Region(5, np.zeros((0, 2)), np.zeros(0), np.zeros((4, 4), dtype=bool))
CONTEXT: Any = SimpleNamespace(observation="all")


def pose(score: float) -> np.ndarray:
    """A pose whose score stands in its translation."""
    made = np.eye(4)
    made[0, 3] = score
    return made


class Estimator:
    """`looks` holds the scores of the instances that each look finds; None: no hypothesis."""

    def has_templates(self, object_id: int) -> bool:
        return False

    def __init__(self, *looks: list[float] | None) -> None:
        self.looks = [*looks]
        self.asked: list[tuple[int, Any]] = []

    def likely_regions(self, context: Any, region: Region) -> Iterator[Region]:
        return (region for _ in range(len(self.looks)))

    def find_hypotheses(self, context: Any, region: Region) -> Any:
        return SimpleNamespace(hypotheses=Hypotheses(np.zeros((0, 4, 4)), np.zeros(0)))

    def refine(
        self, context: Any, object_id: int, hypotheses: Hypotheses, instances: int,
        unexplained: Any, min_score: float | None,
    ) -> RefinedHypotheses | None:  # fmt: skip
        self.asked.append((instances, unexplained))
        scores = self.looks.pop(0)
        if scores is None:
            return None
        found = [Refinement(pose(score), 1) for score in [-1.0, *scores]]  # the first is not chosen
        rows = tuple(range(1, 1 + len(scores)))
        seeds = np.zeros((len(found), 2), dtype=int)
        return RefinedHypotheses(found, np.zeros(len(found)), np.arange(len(found)), seeds, rows)

    def score(self, context: Any, object_id: int, found: np.ndarray) -> float:
        return float(found[0, 3])

    def verifier(self, object_id: int) -> Any:
        def explain(before: str, found: np.ndarray) -> str:
            return f"{before}-{found[0, 3]:g}"

        return SimpleNamespace(
            without_explained=explain,
            evidence=lambda *_: None,
            is_free=lambda *_: np.ones(1, dtype=bool),
        )


def search(
    estimator: Any, instances: int = 1, unexplained: Any = None, min_score: float | None = None
) -> tuple[list[float], list[int]]:
    """Scores and sources of the instances that were found."""
    none = Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))
    found = find_instances(estimator, CONTEXT, REGION, none, instances, unexplained, min_score)
    if found is None:
        return [], []
    chosen = [float(found.refined[row].pose_cam_obj[0, 3]) for row in found.instances]
    return chosen, [int(found.sources[row]) for row in found.instances]


def test_what_is_probably_right_needs_no_fallback() -> None:
    estimator = Estimator([0.8])
    assert search(estimator) == ([0.8], [1])
    assert estimator.asked == [(1, None)]


@pytest.mark.parametrize("first", [[0.2], None])
def test_the_first_right_pose_of_the_fallback_is_taken(first: list[float] | None) -> None:
    estimator = Estimator(first, [0.1], [0.9], [0.95])
    scores, sources = search(estimator)
    assert scores == [0.9] and sources == [-1]
    assert estimator.asked == [(1, None)] * 3


def test_the_best_wrong_pose_remains_if_no_look_finds_a_right_one() -> None:
    assert search(Estimator([0.2], [0.4], None, [0.3])) == ([0.4], [-1])
    assert search(Estimator([0.3], [0.1])) == ([0.3], [1])
    assert search(Estimator(None, None)) == ([], [])
    assert search(Estimator(None, [0.4])) == ([0.4], [-1])


def test_missing_instances_are_looked_for_where_the_others_are_not() -> None:
    estimator = Estimator([0.2, 0.9, 0.1], [0.7, 0.3], [0.4])
    assert search(estimator, 3, "rest")[0] == [0.9, 0.7, 0.4]
    assert estimator.asked == [(3, "rest"), (2, "rest-0.9"), (1, "rest-0.9-0.7")]


def test_explained_pixels_are_taken_from_the_whole_image_if_nothing_else_is() -> None:
    estimator = Estimator([0.9, 0.1], [0.8])
    assert search(estimator, 2)[0] == [0.9, 0.8]
    assert estimator.asked[1] == (1, "all-0.9")


def test_one_instance_is_enough_where_their_number_is_not_known() -> None:
    estimator = Estimator([0.6, 0.3], [0.9])
    assert search(estimator, 10, min_score=0.5)[0] == [0.6, 0.3]
    strict = Estimator([0.6, 0.3], [0.9, 0.2])
    assert search(strict, 10, min_score=0.7)[0] == [0.9, 0.6, 0.3, 0.2]


@pytest.mark.parametrize("min_score", [0.0, 0.05, 0.3])
def test_a_low_min_score_does_not_skip_the_fallback(min_score: float) -> None:
    estimator = Estimator([0.4, 0.1], [0.9, 0.2])
    assert search(estimator, 10, min_score=min_score)[0] == [0.9, 0.4, 0.2, 0.1]
    assert search(Estimator([0.4], [0.9]), 1, min_score=min_score)[0] == [0.9]
    assert search(Estimator([0.6, 0.4]), 10, min_score=min_score)[0] == [0.6, 0.4]
    assert search(Estimator([0.4, 0.1], [0.3]), 10, min_score=min_score)[0] == [0.4, 0.3, 0.1]


def test_no_instance_is_answered_twice() -> None:
    """A worse pose of what a better one explains already is no further answer."""
    estimator: Any = Estimator([0.4, 0.1], [0.9, 0.2])
    before = estimator.verifier

    def strict(object_id: int) -> Any:
        found = before(object_id)
        found.is_free = lambda left, poses, _: np.array([poses[0, 0, 3] != 0.4])
        return found

    estimator.verifier = strict
    assert search(estimator, 10, min_score=0.3)[0] == [0.9, 0.2, 0.1]


def test_without_the_fallback_the_first_look_is_the_only_one_and_needs_no_score() -> None:
    estimator: Any = Estimator([0.2], [0.9])
    estimator.score = None
    none = Hypotheses(np.zeros((0, 4, 4)), np.zeros(0))
    found = find_instances(estimator, CONTEXT, REGION, none, fallback=False)
    assert found is not None and found.refined[found.best].pose_cam_obj[0, 3] == 0.2
    assert len(estimator.asked) == 1
