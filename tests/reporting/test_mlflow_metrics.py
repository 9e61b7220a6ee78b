import pytest

from hlp.reporting.mlflow_metrics import summary_metrics
from written_summary import summary


def test_metrics_bear_the_names_that_mlflow_takes() -> None:
    flat = summary_metrics(summary())
    assert flat["add/recall"] == 0.5
    assert flat["add/recall_cat"] == 0.5
    assert flat["pose_5cm5deg/recall_ci95_low"] == pytest.approx(0.15)
    assert flat["box_iou50/mean_object"] == 0.375
    assert flat["time_ms/total"] == 480.0
    assert flat["time_ms/voting_p95"] is None
    assert flat["waterfall/correct"] == 5
    assert flat["waterfall/few_votes"] == 1
    assert flat["votes/good"] == 0.25
    assert flat["votes/good_weight"] == 0.35
    assert flat["votes/good_by_object_cat"] == pytest.approx(0.425)
    assert flat["votes/good_cat"] == 0.125
    assert flat["votes/good_ape"] is None
    assert flat["median_errors/add_mm"] == 3.5
    assert flat["bop/vsd"] is None
    assert flat["targets"] == 8
