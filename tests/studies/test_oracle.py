import math
from types import SimpleNamespace

import numpy as np
import pytest

from hlp.evaluation import EvaluationSettings
from hlp.geometry import rigid
from hlp.method.find.trace import ObjectTrace
from hlp.records import Hypotheses, Region, Target, TargetScore
from hlp.studies import oracle
from hlp.studies.oracle import CELLS, summarise_oracle

NAMES = {1: "cat", 2: "cup"}
POLICY = EvaluationSettings(bootstrap=200)


def score(frame, object_id, right):
    return TargetScore(
        0, frame, object_id, True, 1.0, math.nan, 0.0, 0.0, 1.0, right, not right, True
    )


def scores(cat, cup):
    """Of ten frames with both objects the first `cat` and `cup` are right."""
    return [score(i, 2, i < cup) for i in range(10)] + [score(i, 1, i < cat) for i in range(10)]


RIGHT = {
    ("estimated", "estimated"): (6, 2),
    ("true", "estimated"): (8, 3),
    ("estimated", "true"): (9, 8),
    ("true", "true"): (10, 9),
}


def test_the_matrix_counts_right_poses_and_what_the_stages_lost_which_is_all_misses():
    assert set(CELLS) == set(RIGHT)
    result = summarise_oracle({c: scores(*RIGHT[c]) for c in CELLS}, NAMES, POLICY, 0)
    assert [(cell["region"], cell["coarse"]) for cell in result["cells"]] == list(CELLS)
    for cell in result["cells"]:
        cat, cup = RIGHT[cell["region"], cell["coarse"]]
        assert cell["add"]["targets"] == 20
        assert cell["add"]["recall"] == pytest.approx((cat + cup) / 20)
        assert list(cell["per_object"]) == ["cat", "cup"]
        for name, right in (("cat", cat), ("cup", cup)):
            found = cell["per_object"][name]
            assert (found["targets"], found["recall"]) == (10, pytest.approx(right / 10))
            low, high = found["ci95"]
            assert low <= right / 10 <= high and (low < high or right in (0, 10))
    assert result["lost"] == {
        "region": pytest.approx(3 / 20),  # 8 right become 11 with the true region
        "coarse pose": pytest.approx(8 / 20),  # … and 19 with the true coarse pose as well
        "fine pose": pytest.approx(1 / 20),
    }
    assert sum(result["lost"].values()) == pytest.approx(1 - 8 / 20)


def test_all_instances_of_an_object_are_looked_for(monkeypatch):
    """Three of one object, of which the estimated region shows two, and votes one."""
    poses = rigid(np.eye(3), np.eye(3))
    targets = tuple(Target(1, pose, 1.0) for pose in poses)

    def visible(_, target):
        return target.pose_cam_obj[None, :3, 3] > 0.0

    def search(_, counts, given, **__):
        found = given[1].hypotheses
        chosen = [] if found is None else list(found.poses_cam_obj[: counts[1]])
        return {1: SimpleNamespace(refined=SimpleNamespace(chosen_poses=chosen))}

    monkeypatch.setattr(oracle, "search_frame", search)
    detection = SimpleNamespace(dataset=SimpleNamespace(frames=SimpleNamespace()))
    detection.dataset.frames.visible_mask = visible
    region = Region(1, np.zeros((0, 2)), np.zeros(0), np.array([[True, True, False]]))
    stored = ObjectTrace(region, hypotheses=Hypotheses(poses[[0, 0, 0, 0]], np.ones(4)))
    context = SimpleNamespace(frame=SimpleNamespace(targets=targets))
    found = oracle._poses_by_cell(detection, context, stored, oracle.OracleSettings())
    assert {cell: len(some) for cell, some in found.items()} == dict(
        zip(CELLS, (3, 0, 2, 3), strict=True)
    )
    assert np.array_equal(found["true", "true"], poses)
