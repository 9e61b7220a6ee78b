import csv
from pathlib import Path

from hlp.reporting.recordings import describe_recordings, write_recordings
from table_text import unpadded
from written_results import scored, write_run, write_sweep

BOP = {"ar": 0.7, "vsd": 0.6, "mssd": 0.7, "mspd": 0.8}


def swept(folder: Path) -> Path:
    """Two data sets of three: the second has no folder, so its arm has no result."""
    write_sweep(folder, ["data"], ["experiment=recordings", "data_folder=data"])
    for number, name in ((0, "board"), (2, "demo")):
        summary = {**scored(0.9 - 0.1 * number, 40.0, {"cat": 0.9}), "bop": BOP}
        write_run(folder / str(number), "recordings", summary, [f"data={name}"])
    (folder / "1").mkdir()
    return folder


def test_all_data_sets_stand_in_one_table(tmp_path: Path) -> None:
    folder = swept(tmp_path / "sweep")
    markdown, table = write_recordings(folder)
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["data"], row["ADD(-S)"], row["AR"], row["VSD"]) for row in rows] == [
        ("board", "0.900", "0.700", "0.600"),
        ("demo", "0.700", "0.700", "0.600"),
    ]
    text = markdown.read_text()
    assert "Made by `hlp -m experiment=recordings data_folder=data`." in text
    assert "Left out or unfinished: 1." in text
    told = unpadded(describe_recordings(tmp_path, "markdown"))
    assert "| board | 2 | 20 | 0.900 |" in told and "Written: " in told
    narrow = [line for line in describe_recordings(tmp_path, "text").split("\n") if "board" in line]
    assert len(narrow) == 1 and len(narrow[0]) <= 80


def test_of_several_seeds_mean_and_standard_deviation_follow(tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "sweep", ["seed", "data"], ["experiment=recordings"])
    arms = [(0, "board", 0.9), (0, "demo", 0.7), (1, "board", 0.8), (1, "demo", 0.7)]
    for number, (seed, name, recall) in enumerate(arms):
        summary = {**scored(recall, 40.0 + 10 * seed, {"cat": recall}), "bop": BOP}
        write_run(folder / str(number), "recordings", summary, [f"seed={seed}", f"data={name}"])
    with write_recordings(folder)[1].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["data"], row["seed"], row["ADD(-S)"], row["ms"]) for row in rows[:5]] == [
        ("board", "0", "0.900", "40"),
        ("board", "1", "0.800", "50"),
        ("board", "mean", "0.850", "45"),
        ("board", "spread", "0.0707", "7"),
        ("demo", "0", "0.700", "40"),
    ]
    assert [row["AR"] for row in rows[4:]] == ["0.700", "0.700", "0.700", "0.0000"]
    assert [row["ECE"] for row in rows] == [""] * 8
    assert "spread: standard deviation between seeds." in (folder / "recordings.md").read_text()
    lines = describe_recordings(tmp_path, "text").split("\n")
    table = [each for each in lines if each.startswith(("board", "demo"))]
    assert len(table) == 8 and max(map(len, table)) <= 80


def test_summaries_without_bops_recalls_leave_the_cells_empty(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", "recordings", scored(0.5, 9.0, {"cat": 0.5}))
    (_, table) = write_recordings(folder)
    with table.open(newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert (row["data"], row["AR"]) == ("bop", "")


def test_other_experiments_have_no_such_table(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", "demo", scored(0.7, 100.0, {"cat": 0.7}))
    assert write_recordings(folder) == []
    assert describe_recordings(tmp_path, "text") == ""
