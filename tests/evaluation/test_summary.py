"""Recalls, calibration error, risk and coverage against plain loops over the definitions."""

import dataclasses
import json
from dataclasses import replace

import numpy as np
import pytest

from hlp.evaluation import EvaluationSettings
from hlp.evaluation.evaluator import FrameTruth
from hlp.evaluation.summary import (
    area_under_risk_coverage,
    calibration_error_by_chance,
    count_false_alarms,
    expected_calibration_error,
    risk_coverage,
    scores_in_vain,
    summarise,
    summarise_calibration,
)
from hlp.records import PoseEstimate, Target, TargetScore
from hlp.results.recalls import reliability

SETTINGS = EvaluationSettings("bop", (), bootstrap=2000)
NAMES = {1: "ape", 6: "cat"}
VOTES = {"total": {"good": 0.25}, "per_object": {}}
TIMINGS = {"total": [100.0, 200.0, 300.0], "holistic": [10.0, 20.0, 30.0]}


def _score(frame_id, object_id, correct, found=True, error=0.004):
    infinite = float("inf")
    return TargetScore(
        scene_id=6,
        frame_id=frame_id,
        object_id=object_id,
        found=found,
        visible_fraction=0.5,
        add_error=error if found else infinite,
        rotation_error=0.1 if found else infinite,
        translation_error=0.01 if found else infinite,
        box_iou=0.8 if found else 0.0,
        add_correct=correct,
        pose_correct=correct and object_id == 6,
        box_correct=found,
        mssd_recall=0.5 if found else 0.0,
        mspd_recall=1.0 if found else 0.0,
        cause="" if correct else "ranking" if found else "few_votes",
    )


SCORES = [
    _score(0, 6, True),
    _score(0, 1, False),
    _score(1, 6, True, error=0.008),
    _score(2, 6, False, found=False),
    _score(3, 1, True),
]


def _summary(scores=SCORES, seed=0):
    return summarise(scores, NAMES, TIMINGS, VOTES, SETTINGS, seed)


def test_what_is_said_of_five_targets():
    summary = _summary()
    assert summary["targets"] == 5
    recalls = {name: metric["recall"] for name, metric in summary["metrics"].items()}
    assert recalls == pytest.approx({"add": 3 / 5, "5cm5deg": 2 / 5, "iou50": 4 / 5})
    assert summary["metrics"]["add"]["mean_object"] == pytest.approx((1 / 2 + 2 / 3) / 2)
    assert list(summary["per_object"]) == ["ape", "cat"]
    cat = summary["per_object"]["cat"]
    assert list(cat) == ["targets", "add", "5cm5deg", "iou50"] and cat["targets"] == 3
    for metric in ("add", "5cm5deg", "iou50"):
        assert cat[metric]["recall"] == pytest.approx(2 / 3)
        low, high = cat[metric]["ci95"]
        assert low < 2 / 3 < high
    assert summary["timing_ms"]["total"] == {"median": 200.0, "p95": pytest.approx(290.0)}
    assert summary["timing_ms"]["holistic"]["median"] == 20.0
    assert summary["votes"] == VOTES
    causes = {name: n for name, n in summary["waterfall"]["total"].items() if n}
    assert causes == {"correct": 3, "ranking": 1, "few_votes": 1}
    medians = {"add_mm": 4.0, "rotation_deg": np.rad2deg(0.1), "translation_mm": 10.0}
    assert summary["median_errors"] == pytest.approx({"found": 4, "box_iou": 0.8, **medians})


@pytest.mark.parametrize(("vsd", "mean"), [(float("nan"), None), (0.6, (0.6 + 0.4 + 0.8) / 3)])
def test_bops_average_recall_is_the_mean_of_the_three_and_none_if_one_was_not_computed(vsd, mean):
    found = _summary([dataclasses.replace(score, vsd_recall=vsd) for score in SCORES])["bop"]
    assert found["mssd"] == pytest.approx(0.4) and found["mspd"] == pytest.approx(0.8)
    assert found["vsd"] == (None if mean is None else pytest.approx(0.6))
    assert found["ar"] == (None if mean is None else pytest.approx(mean))


def test_it_is_strict_json_even_if_nothing_was_found():
    lost = [_score(0, 6, False, found=False)]
    summary = summarise(lost, NAMES, {"total": []}, {}, SETTINGS, 0)
    assert json.loads(json.dumps(summary, allow_nan=False))["metrics"]["add"] == {
        "recall": 0.0,
        "ci95": [0.0, pytest.approx(0.7935, abs=1e-4)],  # Wilson's
        "mean_object": 0.0,
    }
    json.dumps(_summary(), allow_nan=False)


def test_absent_objects_are_counted_once_a_frame_by_their_best_answer():
    truths = [FrameTruth(1, i, np.eye(3), 64, (Target(i + 1, np.eye(4)),)) for i in (0, 1)]
    answers = [  # frame, object, score
        (0, 1, 0.9),  # a target
        (0, 2, 0.4),
        (0, 2, 0.7),
        (1, 1, 0.49),
        (1, 2, 0.2),  # a target
    ]
    estimates = [PoseEstimate(1, frame, i, np.eye(4), score) for frame, i, score in answers]
    estimates.append(PoseEstimate(1, 0, 3, None, 0.0))
    found = count_false_alarms(scores_in_vain(truths, estimates), 0.5)
    assert found.pop("scores") == [0.7, 0.49]
    assert found == {"searched": 3, "alarms": 1, "min_score": 0.5, "rate": 1 / 3}
    assert count_false_alarms([], 0.5)["rate"] is None


def answers(count, seed):
    """Scores of two decimals, so that some are equal, and verdicts that follow them loosely."""
    rng = np.random.default_rng(seed)
    scores = rng.random(count).round(2)
    return scores, rng.random(count) < scores**2


@pytest.mark.parametrize("bins", [1, 7, 10])
def test_calibration_error_is_that_of_its_definition(bins):
    scores, right = answers(500, 1)
    expected = 0.0
    for b in range(bins):
        inside = [i for i, s in enumerate(scores) if min(int(np.floor(s * bins)), bins - 1) == b]
        if inside:
            gap = np.mean([right[i] for i in inside]) - np.mean([scores[i] for i in inside])
            expected += len(inside) / len(scores) * abs(gap)
    assert expected_calibration_error(scores, right, bins) == pytest.approx(expected, abs=1e-12)
    assert reliability(scores, right, bins)[:, 0].sum() == 500


def test_calibration_error_by_chance_is_that_of_many_draws():
    scores = np.random.default_rng(5).beta(2.0, 0.7, 37)
    rng = np.random.default_rng(6)
    draws = [expected_calibration_error(scores, rng.random(37) < scores) for _ in range(20_000)]
    assert calibration_error_by_chance(scores) == pytest.approx(np.mean(draws), abs=1e-3)
    assert calibration_error_by_chance(np.array([0.3])) == pytest.approx(2 * 0.3 * 0.7)
    assert calibration_error_by_chance(np.array([0.0, 1.0])) == 0.0


def test_risk_at_each_coverage_is_that_of_the_answers_above_the_threshold():
    scores, right = answers(300, 2)
    coverage, risk = risk_coverage(scores, right)
    thresholds = sorted(set(scores), reverse=True)
    assert len(coverage) == len(thresholds)
    for i, threshold in enumerate(thresholds):
        kept = scores >= threshold
        assert coverage[i] == pytest.approx(kept.mean())
        assert risk[i] == pytest.approx((~right[kept]).mean())


def test_area_is_the_mean_over_random_orders_of_equal_scores():
    scores, right = answers(60, 3)
    rng = np.random.default_rng(4)
    areas = []
    for _ in range(4000):
        order = np.lexsort((rng.random(60), -scores))
        wrong = np.cumsum(~right[order])
        areas.append(np.mean(wrong / np.arange(1, 61)))
    assert area_under_risk_coverage(scores, right) == pytest.approx(np.mean(areas), abs=1e-3)
    perfect = np.arange(10) / 10
    assert area_under_risk_coverage(perfect, perfect > 0.0) == pytest.approx(0.1 / 10)


def test_summary_counts_the_answers_and_not_what_was_not_found():
    target = TargetScore(1, 2, 3, True, 1.0, 0.001, 0.1, 0.001, 0.9, True, True, True)
    targets = [
        replace(target, score=0.9, add_s_correct=True),
        replace(target, score=0.7, add_s_correct=False),
        replace(target, found=False),
    ]
    found = summarise_calibration(targets)
    assert found["answers"] == 2
    assert found["ece"] == pytest.approx((0.1 + 0.7) / 2)
    assert found["ece_by_chance"] == pytest.approx((2 * 0.9 * 0.1 + 2 * 0.7 * 0.3) / 2)
    assert found["aurc"] == pytest.approx(0.25)
    assert found["risk_coverage"] == [[0.5, 0.0], [1.0, 0.5]]
    assert summarise_calibration(targets[2:])["ece"] is None
