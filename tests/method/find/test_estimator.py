"""What the third stage is told of an object."""

from unittest.mock import Mock

import numpy as np
import pytest

from hlp import Detector
from hlp.method.find import estimator as module
from hlp.records import Hypotheses
from hlp.refinement.score_model import COLORED


@pytest.mark.parametrize("colored", [True, False])
@pytest.mark.parametrize("min_score", [None, 0.5])
def test_hypotheses_are_given_up_early_only_of_coloured_objects_that_may_be_absent(
    min_score, colored, learnt, frame, monkeypatch
):
    told = Mock()
    monkeypatch.setattr(module, "InstanceSearch", told)
    detector = Detector.load(learnt, threads=1)
    with detector._alone() as estimator:
        monkeypatch.setattr(estimator, "has_templates", lambda _: not colored)
        context = estimator.prepare(frame)
        bear = detector.models["bear"]
        coarse = Hypotheses(np.eye(4)[None], np.ones(1))
        estimator.refine(context, bear.object_id, coarse, 1, None, min_score)
        *_, early_score, known = told.call_args.args
        assert (known is context.refined[bear.object_id]) == (not colored)
        if min_score is None or not colored:
            assert early_score is None
        else:
            assert early_score == COLORED


def test_where_no_template_fits_none_is_tried_again(learnt, frame, monkeypatch):
    barren = np.array([3, 7]), np.array([5, 2])  # columns, rows
    tried = Mock(return_value=(Hypotheses(np.zeros((0, 4, 4)), np.zeros(0)), barren))
    monkeypatch.setattr(module, "match_templates", tried)
    detector = Detector.load(learnt, threads=1)
    with detector._alone() as estimator:
        monkeypatch.setattr(estimator, "_templates", lambda *_: None)
        context, bear = estimator.prepare(frame), detector.models["bear"].object_id
        for _ in range(2):
            assert len(estimator.match_templates(context, bear, 1, None)) == 0
    first, second = (call.args[6] for call in tried.call_args_list)
    assert first.all() and np.argwhere(~second).tolist() == [[2, 7], [5, 3]]
