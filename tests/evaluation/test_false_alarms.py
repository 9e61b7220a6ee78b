"""Answers for objects that no target of the frame names."""

import numpy as np

from hlp.evaluation.evaluator import FrameTruth
from hlp.evaluation.summary import count_false_alarms
from hlp.records import PoseEstimate, Target

TRUTHS = [
    FrameTruth(1, 0, np.eye(3), 64, (Target(1, np.eye(4)),)),
    FrameTruth(1, 1, np.eye(3), 64, (Target(2, np.eye(4)),)),
]


def answer(frame: int, object_id: int, score: float, found: bool = True) -> PoseEstimate:
    return PoseEstimate(1, frame, object_id, np.eye(4) if found else None, score)


def test_absent_objects_are_counted_once_a_frame_by_their_best_answer() -> None:
    estimates = [
        answer(0, 1, 0.9),  # a target
        answer(0, 2, 0.4),
        answer(0, 2, 0.7),
        answer(0, 3, 0.0, found=False),
        answer(1, 1, 0.49),
        answer(1, 2, 0.2),  # a target
    ]
    found = count_false_alarms(TRUTHS, estimates, 0.5)
    assert found == {"searched": 3, "alarms": 1, "min_score": 0.5, "rate": 1 / 3}


def test_without_absent_objects_there_is_no_rate() -> None:
    assert count_false_alarms(TRUTHS, [answer(0, 1, 0.9)], 0.5)["rate"] is None
