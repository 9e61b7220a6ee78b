from hlp.reporting.summary_tables import (
    format_summary,
    objects_table,
    time_table,
    timing_words,
    total_table,
    votes_table,
    waterfall_tables,
)
from written_results import summary


def test_objects_table_has_the_papers_figures_beside_ours() -> None:
    table = objects_table(summary())
    assert table.header == ["object", "targets", "ADD(-S)", "5cm5deg", "IoU.5", "paper ADD(-S)"]
    assert list(table.rows) == [
        ["cat", "4", "0.500", "0.250", "0.750", "0.979"],
        ["ape", "4", "0.500", "0.250", "0.750", "0.970"],
        ["mean of objects", "8", "0.250", "0.125", "0.375", "0.974"],
        ["all targets", "8", "0.500", "0.250", "0.750", ""],
        ["95 % interval", "", "0.400-0.600", "0.150-0.350", "0.650-0.850", ""],
    ]


def test_bops_average_recall_is_told_where_it_was_computed() -> None:
    known = {**summary(), "bop": {"ar": 0.7, "vsd": 0.5, "mssd": 0.7, "mspd": 0.9}}
    words = "BOP's average recall: 0.700, the mean of VSD 0.500, MSSD 0.700, MSPD 0.900."
    assert words in format_summary(known) and words in format_summary(known, "markdown")
    assert "BOP" not in format_summary(summary())


def test_calibration_error_stands_beside_that_of_exact_scores() -> None:
    """A summary of an earlier version does not have it."""
    measured = {**summary()["calibration"], "answers": 30, "ece": 0.088, "aurc": 0.01}
    before = "Scores of 30 answers: expected calibration error 0.088"
    said = " ".join(format_summary({**summary(), "calibration": measured}).split())
    assert f"{before}, area under" in said
    measured["ece_by_chance"] = 0.076
    said = " ".join(format_summary({**summary(), "calibration": measured}).split())
    assert f"{before} (0.076 if each was exactly right), area under" in said


def test_paper_is_left_out_where_it_says_nothing() -> None:
    assert "paper ADD(-S)" not in objects_table(summary(("bracket", "cone"))).header
    assert "paper ADD(-S)" not in objects_table(summary(("duck", "cone"))).header  # another duck


def test_time_table_ends_with_the_total() -> None:
    assert list(time_table(summary()).rows) == [
        ["voting", "2.3", ""],
        ["refinement", "", ""],
        ["total", "480", "700"],
    ]


def test_where_targets_ended_in_all_per_object_and_per_visible_fraction() -> None:
    assert list(total_table(summary()).rows) == [
        ["correct", "5", "0.625"],
        ["no window", "0", "0.000"],
        ["few votes", "1", "0.125"],
        ["ranking", "2", "0.250"],
    ]
    objects, visibility = waterfall_tables(summary())
    assert objects.header == ["object", "targets", "correct", "few votes", "ranking"]
    assert list(objects.rows) == [
        ["cat", "4", "3", "1", "0"],
        ["ape", "4", "2", "0", "2"],
        ["all", "8", "5", "1", "2"],
    ]
    assert visibility.header[0] == "visible fraction"
    assert list(visibility.rows) == [["0.6-1", "8", "5", "1", "2"], ["all", "8", "5", "1", "2"]]


def test_votes_table_has_their_number_and_the_share_of_good_ones() -> None:
    assert list(votes_table(summary()).rows) == [
        ["cat", "1000", "0.125", "0.225", "0.325", "0.425"],
        ["ape", "0.0", "", "", "", ""],
        ["all", "1200", "0.250", "0.350", "0.450", "0.550"],
    ]


def test_a_line_says_how_the_times_were_measured() -> None:
    timing = summary()["timing"]
    assert timing_words(summary()) == (
        "Times: measured by this run on 20 frames. Load of the machine meanwhile: 1.2 on 2 cores."
    )
    first = timing_words({"timing": timing | {"first_use_seconds": 7.24, "cpu_ms": 190.4}})
    assert "took 7.2 s (not included). Mean of an object: 190 ms of CPU time in 131 ms of" in first
    again = {"timing": timing | {"reused_stages": ["regions", "poses"], "frames": 1}}
    assert "the results of regions, poses were reused; measured again on 1 f" in timing_words(again)
    shown = format_summary(summary() | again)
    assert shown.index("ms per target") < shown.index("on 1 frame") < shown.index("targets ended")
