"""Where a run reads and writes: too little room, no rights, links, another disk."""

import os
import shutil
import sys
from functools import partial
from pathlib import Path

import pytest
from process import limit_files, obey_permissions

from forked_hlp import run_hlp, succeed
from run_files import poses_of, stages

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


@pytest.fixture
def work(tiny_run, tmp_path):
    """A copy of the tiny run's work folder, without the views of one object and without poses."""
    work = Path(shutil.copytree(tiny_run.folder / "work", tmp_path / "work"))
    shutil.rmtree(min(path.parent for path in (work / "views").glob("*/rgb.npy")))
    shutil.rmtree(min(path.parent for path in (work / "poses").glob("*/stage.json")))
    return work


def ends_well(tiny_run, folder, *overrides):
    """The same command in a folder; the poses must be the same."""
    command = ("run", *tiny_run.overrides, "machine.threads=2", "output=again", *overrides)
    succeed(folder, *command)
    assert poses_of(folder / "again") == poses_of(tiny_run.output)


def fails_in_few_lines(tiny_run, folder, *overrides, first=()):
    """The same command, which cannot work; what it said."""
    command = ("run", *tiny_run.overrides, "machine.threads=2", "output=again", *overrides)
    ended = run_hlp(folder, *command, first=first)
    assert ended.returncode == 1, ended.stderr
    assert ended.stderr.startswith("hlp: "), ended.stderr
    assert ended.stderr.count("\n") <= 3, ended.stderr
    assert not (folder / "again" / "manifest.json").exists()
    return ended.stderr


@pytest.mark.parametrize("longest", [2_000_000, 300_000])
def test_a_file_that_cannot_be_written_whole(tiny_run, tmp_path, work, longest):
    """No room for the views (the first limit), or for the database (the second)."""
    if longest < 2_000_000:
        (work / "mlflow.db").unlink()
    said = fails_in_few_lines(tiny_run, tmp_path, first=[partial(limit_files, longest)])
    assert ("mlflow.db" if longest < 2_000_000 else str(tmp_path / "work")) in said
    ends_well(tiny_run, tmp_path)


@pytest.mark.skipif(sys.platform != "linux", reason="takes root's rights away as Linux has them")
@pytest.mark.parametrize("what", ["views", "mlflow.db", "output"])
def test_a_folder_that_may_only_be_read(tiny_run, tmp_path, work, what):
    closed = {"views": work / "views", "mlflow.db": work, "output": tmp_path / "closed"}[what]
    closed.mkdir(exist_ok=True)
    overrides = (f"output={closed}/again",) if what == "output" else ()
    closed.chmod(0o555)
    try:
        said = fails_in_few_lines(tiny_run, tmp_path, *overrides, first=[obey_permissions])
    finally:
        closed.chmod(0o755)
    assert (what if what == "mlflow.db" else str(closed)) in said
    assert "Permission denied" in said or "readonly" in said or "unable to open" in said
    ends_well(tiny_run, tmp_path)


def test_a_work_folder_of_links_on_another_disk(tiny_run, tmp_path, work):
    """Stage folders, single outputs and the database's folder are links."""
    memory = Path("/dev/shm")  # noqa: S108 (a disk of its own, and a name of its own in it)
    other = memory if os.access(memory, os.W_OK) else tmp_path
    elsewhere = other / f"hlp-{os.getpid()}"
    try:
        shutil.move(work, elsewhere)
        work.mkdir()
        for path in elsewhere.iterdir():
            if not path.name.endswith(".lock"):
                (work / path.name).symlink_to(path)
        single = min(path.parent for path in work.glob("codebook/*/stage.json"))
        moved = Path(shutil.move(single, tmp_path / "single"))
        single.symlink_to(moved)
        ends_well(tiny_run, tmp_path)
        assert stages(tmp_path / "again", reused=False) == {"views": 1, "poses": 1}
        assert (work / "views").is_symlink() and single.is_symlink()
    finally:
        shutil.rmtree(elsewhere, ignore_errors=True)
