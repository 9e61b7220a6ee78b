"""`experiment=recordings`: the table of several data sets, and the figure of their scores."""

from pathlib import Path

import numpy as np

from hlp.reporting.experiments import describe_reports, write_reports
from hlp.reporting.recordings import draw_scores, repeats_of
from hlp.reporting.sweeps import read_sweeps
from table_text import csv_rows, unpadded
from written_results import in_vain, scored, write_run, write_sweep, write_verdicts

COUNTED = "ece,ece_by_chance,sure,sure_wrong,searched_in_vain,false_alarms,ms"
BOP = {"ar": 0.7, "vsd": 0.6, "mssd": 0.7, "mspd": 0.8}


def test_all_data_sets_stand_in_one_table(tmp_path: Path) -> None:
    """The second of three has no folder, so its run has no result; the last has no BOP recalls."""
    overrides = ["experiment=recordings", "data_folder=data"]
    folder = write_sweep(tmp_path / "sweep", ["data"], overrides)
    for number, name in ((0, "board"), (2, "demo")):
        summary = {
            **scored(0.9 - 0.1 * number, 40.0, {"cat": 0.9}),
            "bop": BOP if not number else dict.fromkeys(BOP),
            "calibration": {
                **scored(0.9, 40.0, {})["calibration"],
                "ece": 0.02,
                "ece_by_chance": 0.01,
                "reliability": [[4, 0.3, 0.25], [8, 0.62, 0.75], [4, 0.98, 1.0]],
            },
            "false_alarms": {**in_vain(17, 1), "scores": [0.6, 0.1]},
        }
        write_run(folder / str(number), "recordings", summary, [f"data={name}"])
    (folder / "1").mkdir()
    *_, markdown, table, _, figures = write_reports(folder)
    rows = csv_rows(table)
    assert [*rows[0]] == [
        "data", "frames", "targets", "ADD(-S)", "95 %", "5cm5deg", "AR", "VSD", "MSSD", "MSPD",
        "AP", "ECE", "by chance", "wrong", "false alarms", "ms",
    ]  # fmt: skip
    assert (rows[0]["wrong"], rows[0]["false alarms"]) == ("2/12", "1/17")
    assert (rows[0]["ECE"], rows[0]["by chance"]) == ("0.020", "0.010")
    assert [(row["data"], row["ADD(-S)"], row["AR"], row["VSD"]) for row in rows] == [
        ("board", "0.900", "0.700", "0.600"),
        ("demo", "0.700", "", ""),
    ]
    assert figures.read_text().splitlines() == [
        f"data,targets,add_seed_0,add,add_low,add_high,5cm5deg,ar,{COUNTED}",
        "board,20,0.900,0.900,0.800,0.940,0.700,0.700,0.020,0.010,12,2,17,1,40",
        "demo,20,0.700,0.700,0.600,0.740,0.500,,0.020,0.010,12,2,17,1,40",
    ]
    text = markdown.read_text()
    assert "Made by `hlp -m experiment=recordings data_folder=data`." in text
    assert "left out: 1." in text
    said = unpadded(describe_reports(tmp_path, "markdown"))
    assert "| board | 2 | 20 | 0.900 |" in said and "Written: " in said


def test_of_several_seeds_mean_and_standard_deviation_follow(tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "sweep", ["seed", "data"], ["experiment=recordings"])
    runs = [(0, "board", 0.9), (0, "demo", 0.7), (1, "board", 0.8), (1, "demo", 0.7)]
    for number, (seed, name, recall) in enumerate(runs):
        summary = {**scored(recall, 40.0 + 10 * seed, {"cat": recall}), "bop": BOP}
        given = [f"seed={seed}", f"data={name}"]
        made = write_run(folder / str(number), "recordings", summary, given)
        write_verdicts(made, [1, 1, 0, seed], 0.5 if name == "board" else 0.9)
    *pictures, _, table, _, figures = write_reports(folder)
    assert [path.name for path in pictures] == ["recordings.png", "recordings.svg"]
    rows = csv_rows(table)
    assert [(row["data"], row["seed"], row["ADD(-S)"], row["ms"]) for row in rows[:5]] == [
        ("board", "0", "0.900", "40"),
        ("board", "1", "0.800", "50"),
        ("board", "mean", "0.850", "45"),
        ("board", "spread", "0.0707", "7"),
        ("demo", "0", "0.700", "40"),
    ]
    assert [row["AR"] for row in rows[4:]] == ["0.700", "0.700", "0.700", "0.0000"]
    assert figures.read_text().splitlines() == [
        f"data,targets,add_seed_0,add_seed_1,add,add_low,add_high,5cm5deg,ar,{COUNTED}",
        "board,20,0.900,0.800,0.850,0.800,0.940,0.650,0.700,,,0,0,0,0,45",
        "board below 0.6 visible,1,0.000,1.000,0.500,,,0.500,,,,,,,,",
        "demo,20,0.700,0.700,0.700,0.600,0.740,0.500,0.700,,,0,0,0,0,45",
    ]
    assert "spread: standard deviation between seeds." in (folder / "recordings.md").read_text()


def test_a_curve_of_precision_counts_answers_where_nothing_is(tmp_path: Path) -> None:
    """Four answers, three of them right, and one of two in an empty frame between them."""
    folder = write_sweep(tmp_path / "sweep", ["data"], ["experiment=recordings"])
    summary = {**scored(0.75, 40.0, {"cat": 0.75}), "targets": 4}
    for number, name in enumerate(("board", "demo")):
        given = summary | {"false_alarms": {**in_vain(2, number), "scores": [0.85] * number}}
        made = write_run(folder / str(number), "recordings", given, [f"data={name}"])
        write_verdicts(made, [1, 1, 0, 1], scores=[0.95, 0.9, 0.8, 0.6])
    figure = draw_scores(repeats_of(read_sweeps(folder)[0].results, ["data"]))
    assert figure is not None
    precision, reliability = figure.axes
    curves = [line for line in precision.lines if str(line.get_label()) in ("board", "demo")]
    assert [np.round(line.get_ydata(), 3).tolist() for line in curves] == [
        [1.0, 1.0, 0.667, 0.75],
        [1.0, 1.0, 0.667, 0.5, 0.6],
    ]
    assert curves[1].get_xdata().tolist() == [0.25, 0.5, 0.5, 0.5, 0.75]
    marks = [line.get_xydata()[0] for line in precision.lines if line.get_marker() == "x"]
    assert [mark.tolist() for mark in marks] == [[0.5, 1.0]] * 2
    _, alone, with_alarm = (line.get_xydata().round(3).tolist() for line in reliability.lines)
    assert alone == [[0.6, 1.0], [0.8, 0.0], [0.925, 1.0]]
    assert with_alarm == [[0.6, 1.0], [0.825, 0.0], [0.925, 1.0]]
    assert draw_scores({}) is None
