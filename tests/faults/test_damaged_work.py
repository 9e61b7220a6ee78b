"""What lies in `work` is damaged; the same command ends well, with the same poses."""

import shutil
from pathlib import Path

import pytest

from damage import WAYS, damage
from run_files import poses_of, stages

pytestmark = pytest.mark.slow

MADE = ("views", "classifier", "encoder", "codebook", "regions", "hypotheses", "poses")


@pytest.fixture
def work(tiny_run, tmp_path):
    """A copy of the tiny run's work folder."""
    return Path(shutil.copytree(tiny_run.folder / "work", tmp_path / "work"))


def run_again(call, tiny_run, work):
    """The same command; what it said. The poses must be the same."""
    output, uri = work.parent / "again", f"sqlite:///{work / 'mlflow.db'}"
    overrides = (f"work='{work}'", f"output='{output}'", f"reporting.uri='{uri}'")
    code, said, error = call(*tiny_run.overrides, *overrides)
    assert code == 0, error
    assert "Traceback" not in error
    assert poses_of(output) == poses_of(tiny_run.output)
    return said


def test_every_file_of_every_stage_damaged_in_turn_in_all_ways(tiny_run, call, work):
    """So that every output has to be made again."""
    files = [path for stage in MADE for path in sorted((work / stage).glob("*/*"))]
    files = [path for path in files if path.is_file()]
    for number, path in enumerate(files):
        assert damage([path], list(WAYS)[number % len(WAYS)]) == 1
    said = run_again(call, tiny_run, work)
    again = stages(work.parent / "again", reused=False)
    assert again == {"views": 2, "classifier": 1, "encoder": 1, "codebook": 2} | dict.fromkeys(
        ("regions", "hypotheses", "poses"), 1
    )
    assert said.count(", made again\n") == sum(again.values())
    assert len([*work.glob("*/*.damaged")]) == sum(again.values())
    run_again(call, tiny_run, work)
    assert stages(work.parent / "again", reused=False) == {}


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["my wörk (2)", "a=b, {c} [d] & #e"])
def test_a_work_folder_may_be_moved_and_have_any_name(tiny_run, call, work, name):
    moved = work.parent / name
    work.rename(moved)
    before = {path.name for path in (tiny_run.folder / "work" / "mlflow-artifacts").iterdir()}
    run_again(call, tiny_run, moved)
    assert stages(moved.parent / "again", reused=False) == {}
    after = {path.name for path in (tiny_run.folder / "work" / "mlflow-artifacts").iterdir()}
    assert after == before
