from hlp.reporting.figures.trade_off import draw_recalls
from hlp.reporting.results import Result
from hlp.reporting.tables.paper_tables import RecallColumn, object_columns
from written_results import scored


def run(add: float, objects: dict[str, float]) -> Result:
    return Result({}, scored(add, 100.0, objects), 2, {})


def test_the_figure_has_a_point_for_what_is_known() -> None:
    columns = object_columns(
        {"a": run(0.5, {"cat": 0.5}), "b": run(0.85, {"cat": 0.9, "ape": 0.8})}
    )
    (ax,) = draw_recalls(["cat", "ape"], columns, "title", "note").axes
    first, second = ax.containers
    assert list(first.lines[0].get_ydata()) == [0.5]
    assert list(second.lines[0].get_ydata()) == [0.9, 0.8]
    assert [list(line.get_ydata()) for line in ax.get_lines() if line.get_label() == "paper"] == [
        [0.979, 0.970]
    ]


def test_others_numbers_come_without_intervals() -> None:
    (ax,) = draw_recalls(["ADD(-S)"], [RecallColumn("paper", [0.6], [])], "title", "note").axes
    assert ax.containers == []
