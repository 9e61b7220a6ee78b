"""`experiment=bop` on small copies of BOP's sets, from meshes to files for its server."""

import csv
import re

import pytest

from bop_sets import write_bop_set
from tiny_run import TINY, start_hlp

pytestmark = pytest.mark.slow

OF_THE_DEMO = ("data.", "frames=", "panels=")
SMALL = [word for word in TINY if not word.startswith(OF_THE_DEMO)]


def test_one_command_ends_with_a_table_and_files_for_the_server(tmp_path):
    sets = tmp_path / "sets"
    for name in ("itodd", "tless", "ycbv"):
        (sets / name).mkdir(parents=True)
        write_bop_set(name, sets / name)
    given = (f"data_folder={sets}", *SMALL, "panels=0", "output=out", "reporting=none")
    done = start_hlp(tmp_path, "-m", "experiment=bop", *given, "machine.threads=2")
    assert done.returncode == 0, done.stderr
    assert f"left out: there is no folder {sets / 'lmo'}" in done.stderr + done.stdout
    assert "Poses are found, not scored" in done.stdout  # ITODD's are private
    before, *later = done.stdout.split("What is left, in hours and minutes, as ")[1:]
    assert before.startswith("the demo on two cores: 58 s") and len(later) == 2
    assert later[1].startswith("in 2 finished: ") and "\ntless" not in later[0]
    assert re.search(r"\nall +6 +9 +\d+ +0:06 +0:00 +0.6 GB\n", before), before
    assert before.index("GB\n") < before.index("step 1 of 6")
    with (tmp_path / "out" / "bop.csv").open() as stream:
        table = {row["set"]: row for row in csv.DictReader(stream)}
    assert table.keys() >= {"tless", "ycbv", "mean, localization", "Vidal et al., 2018"}
    for name in ("tless", "ycbv"):
        assert table[name]["images"] == "3" and 0 <= float(table[name]["AR"]) <= 1
    for name in ("itodd", "tless", "ycbv"):
        lines = (tmp_path / "out" / f"hlp_{name}-test.csv").read_text().splitlines()
        assert lines[0] == "scene_id,im_id,obj_id,score,R,t,time" and len(lines) > 2
        times: dict[tuple[str, ...], set[str]] = {}
        for line in lines[1:]:
            cells = line.split(",")
            times.setdefault(tuple(cells[:2]), set()).add(cells[-1])
            assert len(cells[4].split()) == 9 and len(cells[5].split()) == 3
        assert all(len(own) == 1 and float(*own) > 0 for own in times.values())
    again = start_hlp(tmp_path, "-m", "experiment=bop", *given, "machine.threads=2")
    assert again.returncode == 0 and again.stdout.count("finished already") == 3, again.stdout
