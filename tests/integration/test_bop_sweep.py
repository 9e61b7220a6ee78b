"""`experiment=bop` on small copies of BOP's sets, from meshes to files for its server."""

import re

import pytest

from bop_sets import SMALLEST, write_bop_set
from table_text import csv_rows
from tiny_run import start_hlp

pytestmark = pytest.mark.slow


def _check_for_server(path):
    """What the BOP toolkit's check_bop_results (inout.py, fe8b8b7) asks of a file, and the order.

    The files of all seven sets passed that function itself.
    """
    first, *lines = path.read_text().splitlines()
    assert first == "scene_id,im_id,obj_id,score,R,t,time" and lines  # an empty file fails
    rows = [line.split(",") for line in lines]
    times: dict[tuple[str, ...], set[str]] = {}
    for *image, _, score, turn, shift, time in rows:
        assert float(score) >= 0
        assert (len(turn.split()), len(shift.split())) == (9, 3)
        times.setdefault(tuple(image), set()).add(time)
    assert all(len(own) == 1 and float(*own) > 0 for own in times.values())
    ids = [tuple(map(int, row[:3])) for row in rows]
    assert ids == sorted(ids)


def test_one_command_ends_with_a_table_and_files_for_the_server(tmp_path):
    sets = tmp_path / "sets"
    for name in ("itodd", "tless", "ycbv"):
        (sets / name).mkdir(parents=True)
        write_bop_set(name, sets / name)
    command = ("-m", "experiment=bop", f"data_folder={sets}", *SMALLEST)
    done = start_hlp(tmp_path, *command)
    assert done.returncode == 0, done.stderr
    assert f"left out: there is no folder {sets / 'lmo'}" in done.stderr + done.stdout
    assert "Poses are found, not scored" in done.stdout  # ITODD's are private
    before, *later = done.stdout.split("What is left, in hours and minutes: ")[1:]
    assert before.startswith("58 s to learn an object, as the demo's") and len(later) == 2
    assert "as in 2 finished" in later[1] and "\ntless" not in later[0]
    assert done.stdout.index("searching 3 images of ") < done.stdout.index("What is left")
    assert re.search(r"\nall +6 +9 +\d+ +0:06 +0:00 +0.6 GB\n", before), before
    assert before.index("GB\n") < before.index("step 1 of 5")
    table = {row["set"]: row for row in csv_rows(tmp_path / "out" / "bop.csv")}
    assert table.keys() >= {"tless", "ycbv", "mean, localization", "Vidal et al., 2018"}
    for name in ("tless", "ycbv"):
        assert table[name]["images"] == "3" and 0 <= float(table[name]["AR"]) <= 1
    assert table["itodd"]["AR"] == "" and float(table["itodd"]["s"]) > 0
    for name in ("itodd", "tless", "ycbv"):
        _check_for_server(tmp_path / "out" / f"hlp_{name}-test.csv")
    again = start_hlp(tmp_path, *command)
    assert again.returncode == 0 and again.stdout.count("finished already") == 3, again.stdout
