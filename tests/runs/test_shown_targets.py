from dataclasses import replace

import numpy as np
import pytest

from hlp.method.find.trace import ObjectTrace
from hlp.records import Frame, Hypotheses, PoseEstimate, Refinement, Target, TargetScore
from hlp.refinement.choice import RefinedHypotheses
from hlp.runs.pictures import MISSED, RIGHT, missed_targets, page_targets
from hlp.runs.stage_samples import FrameResults

IMAGE, DEPTH = np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4))


def at(z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[2, 3] = z
    return pose


def answer(object_id: int, pose: np.ndarray | None) -> PoseEstimate:
    return PoseEstimate(1, 3, object_id, pose, 0.5)


def found(*estimates: PoseEstimate, **poses: list[float]) -> FrameResults:
    """Object 6 with coarse poses 1 and 2 m away; the fine ones and their sources as given."""
    trace = ObjectTrace(hypotheses=Hypotheses(np.stack([at(1.0), at(2.0)]), np.ones(2)))
    if poses:
        fine = [Refinement(at(z), 0) for z in poses["fine"]]
        sources, count = np.array(poses["sources"], dtype=int), len(fine)
        seeds = np.zeros((count, 2), dtype=int)
        refined = RefinedHypotheses(fine, np.zeros(count), sources, seeds, (0,))
        trace = replace(trace, refined=refined)
    return FrameResults(Frame(1, 3, IMAGE, DEPTH, np.eye(3)), {6: trace}, estimates)


def test_the_answer_for_a_target_is_the_nearest_of_its_object() -> None:
    target, near = Target(6, at(1.0)), answer(6, at(1.2))
    assert found(answer(6, at(2.0)), answer(2, at(1.0)), near).nearest(target) is near
    assert found(answer(6, None)).nearest(target) is None


@pytest.mark.parametrize(("fine", "coarse"), [(1.9, 2.0), (0.9, 1.0), (3.0, None)])
def test_the_coarse_pose_is_the_one_that_was_refined(fine: float, coarse: float | None) -> None:
    # The pose at 3 m comes from the fallback, which has no coarse pose.
    seen = found(fine=[0.9, 1.9, 3.0], sources=[0, 1, -1]).coarse(6, answer(6, at(fine)))
    assert (None if seen is None else seen[2, 3]) == coarse


def test_without_an_answer_the_best_coarse_pose_is_shown() -> None:
    seen = found().coarse(6, None)
    assert seen is not None and seen[2, 3] == 1.0


def test_targets_are_scored_object_by_object() -> None:
    targets = tuple(Target(i, at(z)) for i, z in [(6, 1.0), (2, 1.0), (6, 2.0)])
    results = FrameResults(Frame(1, 3, IMAGE, DEPTH, np.eye(3), targets), {}, ())
    ordered = [(target.object_id, target.pose_cam_obj[2, 3]) for target in results.targets]
    assert ordered == [(6, 1.0), (6, 2.0), (2, 1.0)]


def score(frame: int, object_id: int, right: bool) -> TargetScore:
    return TargetScore(1, frame, object_id, True, 1.0, 0.0, 0.0, 0.0, 1.0, right, right, right)


def test_missed_targets_and_some_right_ones_are_on_the_page() -> None:
    scored = {
        "three": [score(3, 6, True), score(3, 2, False), score(3, 6, False)],
        "four": [score(4, 6, True)],
    }
    assert page_targets(scored) == [
        ((1, 3, 2, 0), "three", 1),
        ((1, 3, 6, 0), "three", 0),
        ((1, 3, 6, 1), "three", 2),
        ((1, 4, 6, 0), "four", 0),
    ]
    assert missed_targets(scored, 6) == [("three", 1), ("three", 2)]


def test_too_many_are_thinned_out_evenly() -> None:
    scored = {str(frame): [score(frame, 1, frame % 2 == 0)] for frame in range(4 * MISSED)}
    chosen = [target.target[1] for target in page_targets(scored)]
    missed, right = ([f for f in chosen if f % 2 == odd] for odd in (1, 0))
    assert (len(missed), len(right)) == (MISSED, RIGHT)
    assert max(np.diff(missed)) <= 4 and missed[0] < 10 and missed[-1] > 4 * MISSED - 10
