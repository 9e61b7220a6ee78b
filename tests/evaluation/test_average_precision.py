"""BOP's average precision: what counts. Its values are compared in test_toolkit_values.py."""

from boxes import EXTENTS, TRUE, K, box_model, moved

from hlp.evaluation.average_precision import MOST_ANSWERS, average_precision
from hlp.evaluation.evaluator import FrameTruth
from hlp.records import PoseEstimate, Target

FAR = moved(dx=1.0)
MODELS = {i: box_model(EXTENTS, i, name, fine=False) for i, name in ((1, "box"), (3, "absent"))}


def _one(pose, score, image=0, object_id=1):
    return PoseEstimate(0, image, object_id, pose, score)


TRUTHS = [FrameTruth(0, 0, K, 640, (Target(1, TRUE),)), FrameTruth(0, 1, K, 640, ())]


def test_a_wrong_answer_costs_precision_if_it_is_surer_and_the_image_shows_the_object():
    right = _one(TRUE, 0.5)
    assert average_precision(TRUTHS, MODELS, [right])["ap"] == 1.0
    assert average_precision(TRUTHS, MODELS, [right, _one(FAR, 0.4)])["ap"] == 1.0
    assert average_precision(TRUTHS, MODELS, [right, _one(FAR, 0.6)])["ap"] == 0.5
    assert average_precision(TRUTHS, MODELS, [right, _one(FAR, 0.6, 1)])["ap"] == 1.0
    assert average_precision(TRUTHS, MODELS, [])["ap"] == 0.0
    assert average_precision(TRUTHS[1:], MODELS, [right])["ap"] is None


def test_the_answers_of_an_image_beyond_the_most_do_not_count():
    others = [_one(FAR, 1.0, object_id=3)] * MOST_ANSWERS
    assert average_precision(TRUTHS, MODELS, [*others, _one(TRUE, 0.5)])["ap"] == 0.0
    assert average_precision(TRUTHS, MODELS, [*others[1:], _one(TRUE, 0.5)])["ap"] == 1.0
