"""Stages over frames in which the number of instances is not known."""

from fake_detection import KEYS, OBJECTS, FakeEstimator, FakeTraining, fake_dataset, method_settings
from hlp.method.find.search import MOST_INSTANCES
from hlp.method.find.trace import STAGES
from hlp.refinement.score_model import MIN_SCORE
from hlp.stages import detection
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore


def test_where_the_number_is_not_known_up_to_so_many_sure_ones_are_looked_for(
    tmp_path, monkeypatch
):
    asked = []

    def search(_, counts, *, min_score, **__):
        asked.append((counts, min_score))
        return {}

    monkeypatch.setattr(detection, "PoseEstimator", FakeEstimator)
    monkeypatch.setattr(detection, "search_frame", search)
    dataset = fake_dataset()
    stages = DetectionStages(dataset, method_settings(), FakeTraining(), StageStore(tmp_path), KEYS)
    frame = stages.load(KEYS[0])
    stages.search(frame)
    known = stages._descriptions(STAGES)
    dataset.search_all = True
    stages.search(frame)
    assert asked == [
        (dict.fromkeys(OBJECTS, 1), None),
        (dict.fromkeys(OBJECTS, MOST_INSTANCES), MIN_SCORE),
    ]
    named = stages._descriptions(STAGES)
    assert all(named[stage][0] != known[stage][0] for stage in STAGES)
