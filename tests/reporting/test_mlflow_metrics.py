import pytest

from hlp.reporting.mlflow_metrics import summary_metrics
from written_summary import summary


def test_metrics_bear_the_names_that_mlflow_takes() -> None:
    flat = summary_metrics(summary())
    assert flat["add_by_object/cat"] == 0.5
    assert flat["ci95/5cm5deg_low"] == pytest.approx(0.15)
    assert flat["mean_object/iou50"] == 0.375
    assert flat["time_ms/total"] == 480.0
    assert flat["time_ms/voting_p95"] is None
    assert flat["waterfall/correct"] == 5
    assert flat["waterfall/few_votes"] == 1
    assert flat["votes/good"] == 0.25
    assert flat["votes/good_weight"] == 0.35
    assert flat["votes_by_object/good_by_object_cat"] == pytest.approx(0.425)
    assert flat["votes_by_object/good_cat"] == 0.125
    assert flat["votes_by_object/good_ape"] is None
    assert flat["median_errors/add_mm"] == 3.5
    assert flat["bop/vsd"] is None
    assert flat["counts/targets"] == 8


def test_what_one_compares_first_stands_above_all_groups() -> None:
    flat = summary_metrics(summary())
    first = {name: value for name, value in flat.items() if "/" not in name}
    assert first == {"add": 0.5, "5cm5deg": 0.25, "iou50": 0.75, "ms": 480.0}


def test_what_columns_show_is_short() -> None:
    long = summary()
    long["metrics"]["add"]["recall"] = 134 / 142
    long["timing_ms"]["total"]["median"] = 912.3456
    flat = summary_metrics(long)
    assert (flat["add"], flat["ms"]) == (0.9437, 912.3)
    assert flat["time_ms/total"] == 912.3456
