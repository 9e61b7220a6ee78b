"""`hlp learn` stopped again and again, and what it had begun damaged in between."""

import signal
from pathlib import Path

import pytest
from damage import WAYS, damage
from process import CODES, LEARNING_PLACES, LINES, Ended, run_hlp, wait_until_gone

from hlp.data.synthetic.objects import demo_objects
from run_files import read_json
from tiny_method import write_mesh

pytestmark = [pytest.mark.slow, pytest.mark.thorough]

SETTINGS = (
    *("encoder=pca", "rendering.viewpoints=24", "rendering.in_plane_steps=3"),
    *("rendering.size_px=64", "patches.pool.per_object=60", "patches.pool.backgrounds=60"),
    *("patches.pool.distractor_scenes=2", "patches.pairs.per_object=60", "classifier.epochs=2"),
    *("classifier.min_batches=0", "score.scenes=2", "machine.threads=2"),
)


def learn(folder: Path, output: str, place: str = "", number: int = 0) -> Ended:
    given = ("mesh=bear.ply,can.ply", f"output={output}", *SETTINGS)
    return run_hlp(folder, "learn", *given, place=place, number=number)


def test_learning_stopped_at_every_place_ends_with_the_same_files(tmp_path: Path) -> None:
    """One place after the other, each in the call that continues the one before."""
    for model in demo_objects().values():
        if model.name in ("bear", "can"):
            write_mesh(tmp_path, model)
    whole = learn(tmp_path, "whole")
    assert whole.returncode == 0, whole.stderr
    for turn, place in enumerate(LEARNING_PLACES):
        number = list(CODES)[turn % len(CODES)]
        stopped = learn(tmp_path, "last", place, number)
        assert stopped.returncode == CODES[number], (place, stopped.stderr)
        if number != signal.SIGKILL:
            assert stopped.stderr.endswith(LINES[CODES[number]]), place
        assert wait_until_gone(tmp_path), place
        if turn % 2:
            begun = (tmp_path / "last.partial").rglob("*")
            damage(begun, list(WAYS)[turn // 2 % len(WAYS)])
    again = learn(tmp_path, "last")  # the last place is one where all is there
    assert again.returncode == 1
    assert "last holds learnt objects already: load it, or name another folder" in again.stderr
    first, second = (read_json(tmp_path / name / "learnt.json") for name in ("whole", "last"))
    assert first["files"] == second["files"]
    left = {str(path.relative_to(tmp_path / "last")) for path in (tmp_path / "last").rglob("*")}
    files = {name for name in left if (tmp_path / "last" / name).is_file()}
    assert files == {*first["files"], "learnt.json"}
    beside = {path.name for path in tmp_path.iterdir()} - {".last.lock"}
    assert beside == {"bear.ply", "can.ply", "whole", "last"}
