"""What the classifier is shown: no more backgrounds than windows of the objects."""

import numpy as np
import pytest

from hlp.method.learn import classifier_training
from hlp.method.settings import ClassifierStage
from hlp.patches.backgrounds import GivenBackgrounds
from hlp.patches.holistic_pool import HolisticPool
from tiny_method import MODELS, tiny_method


@pytest.mark.parametrize(("windows", "crops", "scenes"), [(3, 3, 1), (100, 40, 8)])
def test_backgrounds_are_at_most_as_many_as_windows(monkeypatch, windows, crops, scenes):
    asked = []

    def cut(models, views_of, settings):
        one = np.zeros((windows, 64, 64), np.uint8)
        return HolisticPool(np.stack([one] * 3, axis=-1), one, one > 0, one[:, 0, 0])

    def render(meshes, count, *_):
        asked.append(count)
        return []

    monkeypatch.setattr(classifier_training, "_windows", cut)
    monkeypatch.setattr(classifier_training, "distractor_scenes", render)
    numbers = ("patches.pool.backgrounds=40", "patches.pool.distractor_scenes=8")
    stage = ClassifierStage.of(tiny_method(*numbers))
    given = {1: MODELS["bear"]}, lambda _: None, GivenBackgrounds(), stage
    data = classifier_training.training_windows(*given)
    assert len(data.backgrounds.color) == crops and asked == [scenes]
