"""Which answers the score of an object is calibrated on."""

from types import SimpleNamespace

import numpy as np
import pytest

from hlp.method.learn import score_calibration
from hlp.refinement.score_model import COLORLESS_PRIOR, PRIOR, prior_of
from hlp.rendering.views import ViewsSettings


@pytest.mark.parametrize("colored", [True, False])
def test_answers_are_those_of_a_first_look_or_of_all_that_a_bin_is_searched_for(
    colored, monkeypatch
):
    asked = []

    def search(_, __, counts, **how):
        asked.append((counts, how.get("fallback", True)))
        return {1: SimpleNamespace(refined=None, fits=())}

    mesh = SimpleNamespace(vertices=np.zeros((3, 3)), colored=colored)
    model = SimpleNamespace(mesh=mesh, diameter=0.1, name="part")
    estimator = SimpleNamespace(
        learnt=SimpleNamespace(models={1: model}),
        settings=SimpleNamespace(seed=0, machine=SimpleNamespace(threads=1)),
        prepare=lambda frame: frame,
        has_templates=lambda _: not colored,
        score_model=lambda _: prior_of(colored),
    )
    frame = SimpleNamespace(targets=())
    monkeypatch.setattr(score_calibration, "calibration_scene", lambda *_: frame)
    monkeypatch.setattr(score_calibration, "search_frame", search)
    found = score_calibration.calibrate_score(estimator, 1, (), 2, ViewsSettings())
    assert found is (PRIOR if colored else COLORLESS_PRIOR)  # nothing was found
    assert asked == ([({1: 2}, False)] if colored else [({1: 3}, True)]) * 2
