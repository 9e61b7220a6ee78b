"""Two objects in one frame that claim the same pixels."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hlp.method.find.instances import SearchAgain, resolve_conflicts
from hlp.records import Hypotheses
from hlp.refinement.choice import RefinedHypotheses, refine_and_choose
from hlp.refinement.none import NoneSettings
from hlp.refinement.verification import VerificationSettings, Verifier, observe
from refinement_scene import CAMERA, Scene, disturbed, make_row


class Estimator:
    """Two objects of the same shape under the ids 1 and 2; nothing is refined."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.asked = scene, list[int]()
        self.scores: dict[int, float] | None = None
        self.settings = VerificationSettings()
        self._verifier = Verifier(scene.model, self.settings)

    def verifier(self, object_id: int) -> Verifier:
        return self._verifier

    def has_templates(self, _: int) -> bool:
        return self.scores is not None

    def score(self, _: Any, object_id: int, __: Any) -> float:
        return 1.0 if self.scores is None else self.scores[object_id]

    def search_again(self, context: Any, given: dict[int, Hypotheses]) -> SearchAgain:
        """Refines what was given of an object once more, in what is left."""
        return lambda object_id, left: self.refine(context, object_id, given[object_id], 1, left)

    def refine(
        self, context: Any, object_id: int, hypotheses: Hypotheses, instances: int = 1,
        unexplained: Any = None, min_score: float | None = None,
    ) -> RefinedHypotheses | None:  # fmt: skip
        self.asked.append(object_id)
        refiner = NoneSettings().build(1)
        return refine_and_choose(
            refiner, self._verifier, context.observation, self.scene.model, hypotheses, 8, 0.1, 0,
            instances, unexplained,
        )  # fmt: skip


@pytest.fixture(scope="module")
def row() -> list[Scene]:
    return make_row()


@pytest.fixture(scope="module")
def scene(row: list[Scene]) -> Scene:
    return row[0]


@pytest.fixture(scope="module")
def elsewhere(row: list[Scene]) -> np.ndarray:
    """Where another thing of the same shape stands."""
    return disturbed(row[1], 6.0, 6.0, seed=2)


@pytest.fixture(scope="module")
def context(scene: Scene) -> Any:
    settings = VerificationSettings()
    return SimpleNamespace(observation=observe(scene.rgb, scene.depth, CAMERA, settings))


def hypotheses(*poses: np.ndarray) -> Hypotheses:
    return Hypotheses(np.stack(poses), np.ones(len(poses)))


def test_what_stands_on_anothers_pixels_is_chosen_anew(
    scene: Scene, elsewhere: np.ndarray, context: Any
) -> None:
    estimator = Estimator(scene)
    given = {
        1: hypotheses(scene.pose),
        2: hypotheses(disturbed(scene, 4.0, 4.0, seed=1), elsewhere),
    }
    found = {i: estimator.refine(context, i, each) for i, each in given.items()}
    assert found[2] is not None and found[2].sources[found[2].best] == 0
    resolved = resolve_conflicts(estimator, context, found, estimator.search_again(context, given))
    assert resolved[1] is found[1] and estimator.asked == [1, 2, 2]
    assert resolved[2] is not None and resolved[2].sources[resolved[2].best] == 1


@pytest.mark.parametrize("scores", [{1: 0.9, 2: 0.6}, {1: 0.6, 2: 0.9}])
def test_of_objects_without_colours_the_more_probable_one_stays(
    scene: Scene, context: Any, scores: dict[int, float]
) -> None:
    """The costs of different objects cannot be compared: that of the second is less both times."""
    estimator = Estimator(scene)
    given = {1: hypotheses(disturbed(scene, 4.0, 4.0, seed=1)), 2: hypotheses(scene.pose)}
    found = {i: estimator.refine(context, i, each) for i, each in given.items()}
    estimator.scores = scores
    again = estimator.search_again(context, given)
    resolved = resolve_conflicts(estimator, context, found, again)
    winner = max(scores, key=scores.__getitem__)
    assert resolved[winner] is found[winner] and resolved[3 - winner] is None


def test_an_object_that_has_nothing_of_its_own_is_not_found(scene: Scene, context: Any) -> None:
    estimator = Estimator(scene)
    given = {1: hypotheses(disturbed(scene, 4.0, 4.0, seed=1)), 2: hypotheses(scene.pose)}
    found = {i: estimator.refine(context, i, each) for i, each in given.items()}
    again = estimator.search_again(context, given)
    resolved = resolve_conflicts(estimator, context, found, again)
    assert resolved[1] is None and resolved[2] is found[2]


def test_objects_beside_each_other_keep_their_poses(
    scene: Scene, elsewhere: np.ndarray, context: Any
) -> None:
    estimator = Estimator(scene)
    given = {1: hypotheses(scene.pose), 2: hypotheses(elsewhere), 3: hypotheses(scene.pose)}
    found = {i: estimator.refine(context, i, each) for i, each in given.items() if i < 3}
    again = estimator.search_again(context, given)
    assert resolve_conflicts(estimator, context, found, again) == found
    alone = {1: found[1], 2: None}
    assert resolve_conflicts(estimator, context, alone, again) is alone
