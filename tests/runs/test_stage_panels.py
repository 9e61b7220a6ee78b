from dataclasses import replace

import numpy as np
import pytest

from hlp.method.find.trace import ObjectTrace
from hlp.records import Frame, Hypotheses, PoseEstimate, Refinement, Target
from hlp.refinement.choice import RefinedHypotheses
from hlp.runs.stage_panels import FoundInFrame, in_order_of_scores

IMAGE, DEPTH = np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4))


def at(z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[2, 3] = z
    return pose


def answer(object_id: int, pose: np.ndarray | None) -> PoseEstimate:
    return PoseEstimate(1, 3, object_id, pose, 0.5)


def found(*estimates: PoseEstimate, **poses: list[float]) -> FoundInFrame:
    """Object 6 with coarse poses 1 and 2 m away; the fine ones and their sources as given."""
    trace = ObjectTrace(hypotheses=Hypotheses(np.stack([at(1.0), at(2.0)]), np.ones(2)))
    if poses:
        fine = [Refinement(at(z), 0) for z in poses["fine"]]
        sources, count = np.array(poses["sources"], dtype=int), len(fine)
        seeds = np.zeros((count, 2), dtype=int)
        refined = RefinedHypotheses(fine, np.zeros(count), sources, seeds, (0,))
        trace = replace(trace, refined=refined)
    return FoundInFrame(Frame(1, 3, IMAGE, DEPTH, np.eye(3)), {6: trace}, estimates)


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
    frame = Frame(1, 3, IMAGE, DEPTH, np.eye(3), targets)
    ordered = [(each.object_id, each.pose_cam_obj[2, 3]) for each in in_order_of_scores(frame)]
    assert ordered == [(6, 1.0), (6, 2.0), (2, 1.0)]
