"""Targets of frames that could not be used count as wrong, and are named."""

from types import SimpleNamespace

import numpy as np

from box_scene import at, box_model
from hlp.evaluation import EvaluationSettings
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.evaluation.summary import summarise
from hlp.records import PoseEstimate, Target
from hlp.runs.runner import describe_failed, say_failed, with_failed_frames

KEYS = ("000006_000001", "000006_000002", "000007_000001")
REASONS = {KEYS[1]: "rgb/000002.png is truncated"}


class Frames:
    """Sources state the targets of bad frames."""

    def check(self, key, models): ...

    def stated_targets(self, key):
        assert key == KEYS[1]
        return ((1, 0.4), (1, float("nan")))


def run_of():
    return SimpleNamespace(keys=KEYS, dataset=SimpleNamespace(frames=Frames()))


def scored():
    pose, ids = at(0.0, 0.0, 0.8), ((6, 1), (7, 1))
    truths = [FrameTruth(*id_, np.eye(3), 640, (Target(1, pose),)) for id_ in ids]
    found = [PoseEstimate(*keys, 1, pose, 0.9) for keys in ids]
    return score_targets(truths, {1: box_model()}, found, EvaluationSettings())


def test_they_count_as_wrong_in_the_order_of_the_frames():
    scores = with_failed_frames(run_of(), REASONS, scored())
    places = [(score.scene_id, score.frame_id) for score in scores]
    assert places == [(6, 1), (6, 2), (6, 2), (7, 1)]
    summary = summarise(scores, {1: "box"}, {}, {}, EvaluationSettings(), 0)
    assert summary["targets"] == 4
    assert [summary["metrics"][name]["recall"] for name in ("add", "5cm5deg", "iou50")] == [0.5] * 3
    assert summary["waterfall"]["total"]["bad_frame"] == 2
    assert summary["bop"]["mssd"] == 0.5
    assert summary["waterfall"]["per_visibility"]["0.3-0.6"]["bad_frame"] == 1


def test_without_any_nothing_changes():
    scores = scored()
    assert with_failed_frames(run_of(), {}, scores) == scores


def test_they_are_named(caplog):
    assert describe_failed(REASONS) == [
        {"scene_id": 6, "im_id": 2, "reason": "rgb/000002.png is truncated"}
    ]
    say_failed({}, 3)
    assert not caplog.records
    say_failed(REASONS, 3)
    (record,) = caplog.records
    assert "1 of 3 frames could not be used" in record.message
