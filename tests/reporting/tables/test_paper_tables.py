from hlp.reporting.results import Result
from hlp.reporting.tables.paper_tables import (
    metric_recalls_table,
    object_recalls_table,
)
from written_results import scored

CATS = {"cat": 0.9, "ape": 0.8}


def run(add: float, objects: dict[str, float]) -> Result:
    return Result({}, scored(add, 100.0, objects), 2, {})


def test_table_1_has_the_paper_first_and_its_mean_over_the_same_objects() -> None:
    table = object_recalls_table({"ours": run(0.85, CATS)})
    assert list(table.header) == ["object", "targets", "paper", "ours", "95 %"]
    assert [list(row) for row in table.rows] == [
        ["cat", "20", "0.979", "0.900", "0.700-0.950"],
        ["ape", "20", "0.970", "0.800", "0.600-0.850"],
        ["mean of objects", "", "0.974", "0.850", ""],
        ["standard deviation", "", "0.005", "0.050", ""],
        ["all targets", "40", "", "0.850", "0.750-0.890"],
    ]


def test_table_1_of_other_objects_has_ours_alone() -> None:
    """Another set's duck is another duck."""
    table = object_recalls_table({"ours": run(0.85, {"duck": 0.9, "wedge": 0.8})})
    assert list(table.header) == ["object", "targets", "ours", "95 %"]
    assert [row[0] for row in table.rows][:2] == ["duck", "wedge"]


def test_table_1_of_two_runs_leaves_blank_what_one_was_not_asked_for() -> None:
    runs = {"method paper": run(0.5, {"cat": 0.5}), "method hlp": run(0.85, CATS)}
    table = object_recalls_table(runs)
    assert list(table.header[3:]) == ["method paper", "95 %", "method hlp", "95 %"]
    assert list(table.rows[1]) == ["ape", "", "0.970", "", "", "0.800", "0.600-0.850"]
    assert list(table.rows[2][3:]) == ["0.500", "", "0.850", ""]


def test_table_2_has_the_printed_numbers_beside_ours() -> None:
    table = metric_recalls_table({"ours": run(0.7, CATS)})
    assert list(table.header) == ["recall", "paper", "Brachmann et al.", "ours", "95 %"]
    assert [list(row) for row in table.rows] == [
        ["ADD(-S)", "0.632", "0.566", "0.700", "0.600-0.740"],
        ["5cm5deg", "0.362", "0.227", "0.500", "0.400-0.540"],
        ["IoU.5", "0.799", "0.620", "0.750", "0.650-0.790"],
    ]
