"""Runs, sweeps and `hlp learn` stopped again and again; what they had begun is damaged in between.

One place after the other, each in the call that continues the one before.
"""

import shutil
import signal
from collections import Counter

import pytest
from process import CODES, LEARNING_PLACES, LINES, PLACES, SWEEP_PLACES, stop_hlp

from damage import WAYS, damage
from forked_hlp import run_hlp, succeed
from hlp.data.synthetic.objects import demo_objects
from hlp.reporting.mlflow.pages import HEADLINES
from run_files import children_of, logged_runs, poses_of, read_json
from tiny_method import write_mesh

pytestmark = [pytest.mark.slow, pytest.mark.thorough]

LEARNING = (
    *("encoder=pca", "rendering.viewpoints=24", "rendering.in_plane_steps=3"),
    *("rendering.size_px=64", "patches.pool.per_object=60", "patches.pool.backgrounds=60"),
    *("patches.pool.distractor_scenes=2", "patches.pairs.per_object=60", "classifier.epochs=2"),
    *("classifier.min_batches=0", "machine.threads=2"),
)


def stop_everywhere(folder, places, command, begun):
    """Stop a command at each place; every second time, damage the files that it had begun."""
    for turn, place in enumerate(places):
        number = list(CODES)[turn % len(CODES)]
        more = ("executor=loky",) if place == "frame of a worker" else ()
        stopped = stop_hlp(folder, place, number, *command, *more)
        assert "Traceback" not in stopped.stderr, place
        if number != signal.SIGKILL and command[1] != "-m":
            assert stopped.stderr == LINES[CODES[number]], place
        if turn % 2 and begun:
            damage(folder.glob(begun), list(WAYS)[turn // 2 % len(WAYS)])


def test_a_run_ends_with_the_same_poses(tiny_run, tmp_path):
    command = ("run", *tiny_run.overrides, "machine.threads=2", "output=last")
    stop_everywhere(tmp_path, PLACES, command, "work/*/*.partial/**/*")
    assert not (tmp_path / "last" / "manifest.json").exists()
    succeed(tmp_path, *command)
    assert poses_of(tmp_path / "last") == poses_of(tiny_run.output)
    found = Counter(run.info.status for run in logged_runs(tmp_path)[1])
    assert found.pop("FINISHED") == 1 and set(found) == {"KILLED"}
    hidden = [path for path in (tmp_path / "work").rglob(".*") if ".hydra" not in path.parts]
    assert {path.name for path in hidden} <= {".in-use"}
    assert not list((tmp_path / "work").rglob("*.partial"))


def test_a_sweep_loses_no_setting_and_does_none_twice(tiny_run, tmp_path):
    """It continues in the same folder, as the same runs of MLflow."""
    shutil.copytree(tiny_run.folder / "work", tmp_path / "work")
    (tmp_path / "work" / "mlflow.db").unlink()
    command = ("run", "-m", *tiny_run.overrides, "panels=0", "name=swept", "machine.threads=1")
    command += ("refinement.particles=25,26",)
    stop_everywhere(tmp_path, SWEEP_PLACES, command, "")
    ended = succeed(tmp_path, *command)
    assert "continuing the sweep in" in ended.stdout
    assert "finished already: particles 25" in ended.stdout
    (record,) = (tmp_path / "outputs").glob("swept/*/sweep.json")
    assert read_json(record)["status"] == "FINISHED"
    assert poses_of(record.parent / "0") == poses_of(tiny_run.output)
    second = read_json(record.parent / "1" / "manifest.json")
    assert second["config"]["refinement"]["particles"] == 26
    _, parent, children = children_of(tmp_path, record.parent)
    assert parent.info.status == "FINISHED"
    shown = [{name: run.data.metrics[name] for name in HEADLINES} for run in (parent, *children)]
    assert shown[0] in shown[1:]  # the best one's
    found = sorted((run.data.params["refinement.particles"], run.info.status) for run in children)
    assert found == [("25", "FINISHED"), ("26", "FINISHED")]
    assert "RUNNING" not in {run.info.status for run in logged_runs(tmp_path)[1]}


def test_learning_ends_with_the_same_files(tmp_path):
    for model in demo_objects().values():
        if model.name in ("bear", "can"):
            write_mesh(tmp_path, model)
    command = ("learn", "mesh=bear.ply,can.ply", *LEARNING)
    succeed(tmp_path, *command, "output=whole")
    stop_everywhere(tmp_path, LEARNING_PLACES, (*command, "output=last"), "last.partial/**/*")
    again = run_hlp(tmp_path, *command, "output=last")  # at the last place all is there
    assert again.returncode == 1
    assert "last holds learnt objects already: load it, or name another folder" in again.stderr
    first, second = (read_json(tmp_path / name / "learnt.json") for name in ("whole", "last"))
    assert first["files"] == second["files"]
    files = {
        str(path.relative_to(tmp_path / "last"))
        for path in (tmp_path / "last").rglob("*")
        if path.is_file()
    }
    assert files == {*first["files"], "learnt.json"}
    beside = {path.name for path in tmp_path.iterdir()} - {".last.lock"}
    assert beside == {"bear.ply", "can.ply", "whole", "last"}
