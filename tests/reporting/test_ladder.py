import csv
from pathlib import Path

import numpy as np
import pytest

from hlp.records import TargetScore
from hlp.reporting.ladder import arms_of, describe_ladders, gain_of, write_ladder
from hlp.reporting.results import read_results
from hlp.results.intervals import difference_interval
from hlp.results.poses_file import write_scores
from table_text import unpadded
from written_results import scored, write_run, write_sweep

RIGHT = {"literal": [0, 0, 0, 1], "modes": [1, 0, 1, 1], "best": [1, 1, 1, 0]}
BEFORE = {"literal": None, "modes": "literal", "best": "modes"}


def verdict(frame: int, object_id: int, right: bool) -> TargetScore:
    errors = 0.001, 0.01, 0.001
    return TargetScore(1, frame, object_id, True, 0.9, *errors, 0.9, right, right, right, 0.5, 0.5)


def swept(folder: Path, arms: tuple[str, ...] = ("literal", "modes", "best")) -> Path:
    """Arms that find four targets, two each in two frames, as `RIGHT` says."""
    write_sweep(folder, ["ladder"], ["experiment=ladder"])
    for number, name in enumerate(arms):
        summary = scored(float(np.mean(RIGHT[name])), 100.0 - 20.0 * number, {"ape": 0.5})
        summary["bop"] = {"ar": 0.5 + 0.125 * number}
        arm = {"change": f"what {name} is", "before": BEFORE[name]}
        run = folder / str(number)
        write_run(run, "ladder", summary, [f"ladder={name}"])
        manifest = (run / "manifest.json").read_text()
        arm_text = f'"config": {{"arm": {str(arm).replace(chr(39), chr(34))}, '
        arm_text = arm_text.replace("None", "null")
        (run / "manifest.json").write_text(manifest.replace('"config": {', arm_text, 1))
        scores = [verdict(i // 2, i % 2, bool(RIGHT[name][i])) for i in range(4)]
        write_scores(run / "scores.csv", scores, {0: "ape", 1: "can"})
    return folder


def test_a_row_an_arm_with_what_it_gains_against_the_arm_before_it(tmp_path: Path) -> None:
    folder = swept(tmp_path / "sweep")
    files = write_ladder(folder)
    assert [path.name for path in files] == ["ladder.png", "ladder.svg", "ladder.md", "ladder.csv"]
    assert all(path.stat().st_size for path in files)
    with files[3].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    told = [(r["arm"], r["ADD(-S)"], r["against"], r["ADD(-S) gained"], r["ms more"]) for r in rows]
    assert told == [
        ("literal", "0.250", "–", "–", "–"),
        ("modes", "0.750", "literal", "+0.500", "-20"),
        ("best", "0.750", "modes", "+0.000", "-20"),
    ]
    assert [row["AR"] for row in rows] == ["0.500", "0.625", "0.750"]
    # Both frames of `modes` gain one target of two: resamples are alike, and Wilson's width stands.
    assert rows[1]["95 % of it"] == "+0.010 to +0.990"
    text = files[2].read_text()
    assert "Made by `hlp -m experiment=ladder`." in text and "what modes is" in text
    assert "| literal | what literal is | 0.250 |" in unpadded(
        describe_ladders(tmp_path, "markdown")
    )
    (row,) = [
        line for line in describe_ladders(tmp_path, "text").split("\n") if "modes " in line[:6]
    ]
    assert row.split() == [
        "modes",
        "0.750",
        "80",
        "literal",
        "+0.500",
        "+0.010",
        "to",
        "+0.990",
        "-20",
    ]


def test_gains_are_those_of_the_paired_bootstrap(tmp_path: Path) -> None:
    arms = {arm.name: arm for arm in arms_of(read_results(swept(tmp_path / "sweep")))}
    before, after = (np.array(RIGHT[name], dtype=bool) for name in ("modes", "best"))
    low, high = difference_interval(before, after, np.array([0, 0, 1, 1]), 10_000, 0)
    gain = gain_of(arms["best"], arms)
    assert gain is not None and gain.interval == (low, high)
    # Frame 0 gains one of two targets, frame 1 loses one.
    assert (low, high) == (-0.5, 0.5) and gain.recall == pytest.approx(0.0)


def test_an_arm_whose_predecessor_was_not_run_stands_alone(tmp_path: Path) -> None:
    folder = swept(tmp_path / "sweep", ("literal", "best"))
    with write_ladder(folder)[3].open(newline="") as stream:
        assert [row["against"] for row in csv.DictReader(stream)] == ["–", "–"]


def test_other_experiments_have_no_ladder(tmp_path: Path) -> None:
    write_run(tmp_path / "run", "demo", scored(0.7, 100.0, {"cat": 0.7}))
    assert write_ladder(tmp_path / "run") == [] and describe_ladders(tmp_path, "text") == ""
