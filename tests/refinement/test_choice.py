"""Which hypotheses are refined: those worth it, best first; the answer is polished."""

from dataclasses import replace

import numpy as np
import pytest
from refinement_scene import CAMERA, Scene, disturbed, error

from hlp.records import Hypotheses, ObjectModel, Refinement
from hlp.refinement.choice import RefinedHypotheses, refine_and_choose
from hlp.refinement.verification import VerificationSettings, Verifier, observe


class Still:
    """Leaves poses where they are, and writes down what it was asked."""

    def __init__(self) -> None:
        self.asked: list[np.ndarray] = []
        self.spent: list[float] = []
        self.polished: list[np.ndarray] = []

    def refine(
        self, model: ObjectModel, depth: np.ndarray, camera_matrix: np.ndarray,
        hypotheses: Hypotheses, seed: int, spent: float = 0.0,
    ) -> list[Refinement]:  # fmt: skip
        self.asked.append(hypotheses.poses_cam_obj)
        self.spent.append(spent)
        return [Refinement(pose, 1) for pose in hypotheses.poses_cam_obj]

    def polish(
        self, model: ObjectModel, depth: np.ndarray, camera_matrix: np.ndarray,
        answer: Refinement, seed: int, spent: float = 0.0,
    ) -> Refinement:  # fmt: skip
        self.polished.append(answer.pose_cam_obj)
        self.spent.append(spent)
        return Refinement(answer.pose_cam_obj, answer.iterations + 1)


def choose(
    scene: Scene,
    verification: VerificationSettings,
    refiner: Still,
    poses: np.ndarray,
    candidates: int = 8,
    max_improvement: float = 0.1,
) -> RefinedHypotheses:
    # Support is left out of the cost: all have the same.
    hypotheses = Hypotheses(poses, np.ones(len(poses)))
    return refine_and_choose(
        refiner,
        Verifier(scene.model, verification),
        observe(scene.rgb, scene.depth, CAMERA, verification),
        scene.model,
        hypotheses,
        candidates,
        max_improvement,
        seed=3,
    )


@pytest.fixture
def poses(scene: Scene) -> np.ndarray:
    """From bad to good: the last is right."""
    return np.stack([disturbed(scene, 12 * k, 6 * k, seed=k) for k in range(6)][::-1])


def test_the_best_is_found_refined_first_and_polished(
    scene: Scene, verification: VerificationSettings, poses: np.ndarray
) -> None:
    refiner = Still()
    fine = choose(scene, verification, refiner, poses, max_improvement=1.0)
    assert len(refiner.asked) == 3 and len(fine.refined) == len(fine.costs) == 6
    np.testing.assert_array_equal(refiner.asked[0][0], poses[-1])
    assert fine.sources[fine.best] == 5 and sorted(fine.sources) == list(range(6))
    for source, refined in zip(fine.sources, fine.refined, strict=True):
        np.testing.assert_array_equal(refined.pose_cam_obj, poses[source])
    np.testing.assert_array_equal(refiner.polished, poses[-1:])
    assert fine.refined[fine.best].iterations == 2
    assert error(scene, fine.refined[fine.best].pose_cam_obj) < 1e-9
    assert 0 < refiner.spent[0] < refiner.spent[1] < refiner.spent[-1]


def test_no_more_are_refined_than_asked_for(
    scene: Scene, verification: VerificationSettings, poses: np.ndarray
) -> None:
    fine = choose(scene, verification, Still(), poses, candidates=3, max_improvement=1.0)
    observation = observe(scene.rgb, scene.depth, CAMERA, verification)
    costs = Verifier(scene.model, verification).costs(observation, poses)
    np.testing.assert_array_equal(fine.sources, np.argsort(costs)[:3])


def test_hopeless_ones_are_left_out(
    scene: Scene, verification: VerificationSettings, poses: np.ndarray
) -> None:
    observation = observe(scene.rgb, scene.depth, CAMERA, verification)
    costs = np.sort(Verifier(scene.model, verification).costs(observation, poses))
    apart = costs[2] - costs[0]
    assert apart > 0.02
    assert (
        len(choose(scene, verification, Still(), poses, max_improvement=apart * 0.9).refined) == 2
    )
    assert len(choose(scene, verification, Still(), poses, max_improvement=apart * 1.1).refined) > 2


def test_one_hypothesis_is_enough(
    scene: Scene, verification: VerificationSettings, poses: np.ndarray
) -> None:
    fine = choose(scene, replace(verification, candidates=1), Still(), poses[:1])
    assert fine.best == 0 and len(fine.refined) == 1


def test_a_pose_that_is_not_finite_is_named(
    scene: Scene, verification: VerificationSettings, poses: np.ndarray
) -> None:
    poses[1, 0, 0] = np.nan
    with pytest.raises(ValueError, match="hypothesis 1"):
        choose(scene, verification, Still(), poses)
