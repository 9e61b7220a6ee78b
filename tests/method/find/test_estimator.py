"""What the third stage is told of an object."""

import numpy as np
import pytest

from hlp import Detector
from hlp.method.find import estimator as module
from hlp.records import Hypotheses


@pytest.mark.parametrize("colored", [True, False])
@pytest.mark.parametrize("min_score", [None, 0.5])
def test_hypotheses_are_given_up_early_only_of_coloured_objects_that_may_be_absent(
    min_score, colored, learnt, frame, monkeypatch
):
    given = []
    monkeypatch.setattr(module, "refine_and_choose", lambda *args: given.append(args))
    detector = Detector.load(learnt, threads=1)
    with detector._alone() as estimator:
        monkeypatch.setattr(estimator, "has_templates", lambda _: not colored)
        context = estimator.prepare(frame)
        bear = detector.models["bear"]
        (true,) = (t.pose_cam_obj for t in frame.targets if t.object_id == bear.object_id)
        coarse = Hypotheses(true[None], np.ones(1))
        estimator.refine(context, bear.object_id, coarse, 1, None, min_score)
        *_, early_score = given[0]
        if min_score is None or not colored:
            assert early_score is None
        else:
            assert early_score == estimator.score_model(bear.object_id)
