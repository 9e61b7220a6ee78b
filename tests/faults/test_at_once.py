"""Several processes at work in the same folders."""

import shutil

import pytest

from forked_hlp import Running, run_hlp
from run_files import logged_runs, poses_of, stages

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


@pytest.fixture
def learnt(tiny_run, tmp_path):
    """A folder with what the tiny run has learnt, but for one codebook, and without a database."""
    for stage in ("views", "classifier", "encoder", "codebook"):
        shutil.copytree(tiny_run.folder / "work" / stage, tmp_path / "work" / stage)
    shutil.rmtree(min((tmp_path / "work" / "codebook").glob("*/stage.json")).parent)
    return tmp_path


def test_two_identical_runs_at_once_make_everything_once(tiny_run, learnt):
    """Also the database. A report that is asked for meanwhile sees whole results or none."""
    outputs = [learnt / name for name in ("one", "two")]
    command = ("run", *tiny_run.overrides, "machine.threads=1")
    runs = [Running(learnt, *command, f"output={path.name}") for path in outputs]
    asked = 0
    while any(run.process.is_alive() for run in runs):
        report = run_hlp(learnt, "report", "output=one")
        asked += 1
        if report.returncode != 0:
            assert (report.returncode, report.stderr.count("\n")) == (1, 1), report.stderr
            assert report.stderr.startswith("hlp: "), report.stderr
    assert asked > 0
    for run in runs:
        ended = run.wait()
        assert ended.returncode == 0, ended.stderr
    made = [stages(path, reused=False) for path in outputs]
    for stage in ("codebook", "regions", "hypotheses", "poses"):
        assert sum(counts.get(stage, 0) for counts in made) == 1, made
    assert [poses_of(path) for path in outputs] == [poses_of(tiny_run.output)] * 2
    assert statuses(learnt) == ["FINISHED", "FINISHED"]
    assert run_hlp(learnt, "report", "output=one").returncode == 0


def statuses(folder):
    """How the runs of a folder's database ended."""
    return [run.info.status for run in logged_runs(folder)[1]]
