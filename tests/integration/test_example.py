"""The object and the frame that HLP ships, as README's first command finds the one in the other.

Where the format of what is learnt has moved on, `make example` makes it anew.
"""

import shutil

import pytest

from forked_hlp import run_hlp, succeed
from hlp import Detector
from hlp.evaluation.errors import add
from hlp.files import shipped_folder
from hlp.method.learn.learnt_folder import FORMAT
from run_files import read_json, stated_pose

LARGEST = 3e6  # bytes of all of it, in every wheel


@pytest.mark.slow
def test_readmes_first_command_finds_the_example_and_says_where_its_picture_is(tmp_path):
    done = succeed(tmp_path, "predict", "learnt=example", "output=found")
    assert "Pictures  found/panels/000000.png\n" in done.stdout
    assert (tmp_path / "found/panels/000000.png").stat().st_size > 10_000
    (found,) = read_json(tmp_path / "found/poses.json")["poses"]
    (true,) = read_json(shipped_folder("example") / "frames/scene_gt.json")["0"]
    (model,) = Detector.load(shipped_folder("example") / "learnt").models.values()
    error = add(stated_pose(found), stated_pose(true), model.mesh.vertices)
    assert error < 0.02 * model.diameter and found["score"] > 0.9


def test_a_folder_in_the_cache_goes_before_and_another_format_is_said(tmp_path):
    mine = tmp_path / "work/objects/example"
    shutil.copytree(shipped_folder("example") / "learnt", mine)
    record = mine / "learnt.json"
    record.write_text(f'{{"format": {FORMAT - 1}}}')
    done = run_hlp(tmp_path, "predict", "learnt=example", "work=work")
    assert done.returncode == 1
    assert f"{record}: format is {FORMAT - 1}, this version of HLP reads {FORMAT}" in done.stderr


def test_it_is_small():
    sizes = [path.stat().st_size for path in shipped_folder("example").rglob("*")]
    assert sum(sizes) < LARGEST
