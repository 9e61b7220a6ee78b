"""A run that is stopped again and again, and what it had begun damaged in between."""

import signal
from pathlib import Path

import pytest
from damage import WAYS, damage
from mlflow import MlflowClient
from process import CODES, LINES, PLACES, run_hlp, wait_until_gone

from run_files import read_json
from tiny_run import TinyRun

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


def statuses(folder: Path) -> list[str]:
    client = MlflowClient(f"sqlite:///{folder / 'work' / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("demo")
    assert experiment is not None
    return sorted(run.info.status for run in client.search_runs([experiment.experiment_id]))


def test_a_run_stopped_at_every_place_ends_with_the_same_poses(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    """One place after the other, each in the run that continues the one before."""
    command = ("run", *tiny_run.overrides, "machine.threads=2", "output=last")
    for turn, place in enumerate(PLACES):
        number = list(CODES)[turn % len(CODES)]
        more = ("executor=loky",) if place == "frame of a worker" else ()
        stopped = run_hlp(tmp_path, *command, *more, place=place, number=int(number))
        assert stopped.returncode == CODES[number], (place, stopped.stderr)
        if number != signal.SIGKILL:
            assert stopped.stderr.endswith(LINES[CODES[number]]), place
            assert stopped.stderr.count("\n") == 1, (place, stopped.stderr)
        assert wait_until_gone(tmp_path), place
        assert not (tmp_path / "last" / "manifest.json").exists()
        begun = (tmp_path / "work").glob("*/*.partial/**/*")
        if turn % 2:
            damage(begun, list(WAYS)[turn // 2 % len(WAYS)])
    ended = run_hlp(tmp_path, *command)
    assert ended.returncode == 0, ended.stderr
    poses = read_json(tmp_path / "last" / "manifest.json")["poses"]
    assert poses == read_json(tiny_run.output / "manifest.json")["poses"]
    found = statuses(tmp_path)
    assert found.count("FINISHED") == 1
    assert set(found) == {"FINISHED", "KILLED"}
    left = [path for path in (tmp_path / "work").rglob("*") if path.name.endswith(".partial")]
    assert left == []
    hidden = [path for path in (tmp_path / "work").rglob(".*") if ".hydra" not in path.parts]
    assert {path.name for path in hidden} <= {".in-use"}
