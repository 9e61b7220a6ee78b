"""Calibration error, risk and coverage against plain loops over the definitions."""

from dataclasses import replace

import numpy as np
import pytest

from hlp.evaluation.summary import (
    area_under_risk_coverage,
    expected_calibration_error,
    reliability,
    risk_coverage,
    summarise_calibration,
)
from hlp.records import TargetScore


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


def test_what_is_no_answer_is_refused():
    with pytest.raises(ValueError, match="no answer"):
        expected_calibration_error(np.zeros(0), np.zeros(0, bool))
    with pytest.raises(ValueError, match="no answer"):
        risk_coverage(np.zeros(0), np.zeros(0, bool))
    with pytest.raises(ValueError, match="from 0 to 1"):
        expected_calibration_error(np.array([1.5]), np.array([True]))


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
    assert found["aurc"] == pytest.approx(0.25)
    assert found["risk_coverage"] == [[0.5, 0.0], [1.0, 0.5]]
    assert summarise_calibration(targets[2:])["ece"] is None
