"""What lies in `work` is damaged; the same command ends well, with the same poses."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from damage import WAYS, damage

from run_files import read_json, stages
from tiny_run import TinyRun

pytestmark = pytest.mark.slow

Call = Callable[..., tuple[int, str, str]]

MADE = ("views", "classifier", "encoder", "codebook", "regions", "hypotheses", "poses")


@pytest.fixture
def work(tiny_run: TinyRun, tmp_path: Path) -> Path:
    """A copy of the tiny run's work folder."""
    return Path(shutil.copytree(tiny_run.folder / "work", tmp_path / "work"))


def run_again(call: Call, tiny_run: TinyRun, work: Path) -> str:
    """The same command; what it said. The poses must be the same."""
    output, uri = work.parent / "again", f"sqlite:///{work / 'mlflow.db'}"
    overrides = (f"work='{work}'", f"output='{output}'", f"reporting.uri='{uri}'")
    code, said, error = call(*tiny_run.overrides, *overrides)
    assert code == 0, error
    assert "Traceback" not in error
    first, second = (read_json(each / "manifest.json") for each in (tiny_run.output, output))
    assert first["poses"] == second["poses"]
    return said


@pytest.mark.parametrize("way", WAYS)
def test_damaged_files_of_all_stages_are_made_again(
    tiny_run: TinyRun, call: Call, work: Path, way: str
) -> None:
    files = [path for stage in MADE for path in (work / stage).glob("*/*") if path.is_file()]
    assert damage((path for path in files if path.name != "stage.json"), way) > 50
    said = run_again(call, tiny_run, work)
    again = stages(work.parent / "again", reused=False)
    assert again == {"views": 8, "classifier": 1, "encoder": 1, "codebook": 8} | dict.fromkeys(
        ("regions", "hypotheses", "poses"), 1
    )
    assert said.count(", made again\n") == sum(again.values())
    assert len([*work.glob("*/*.damaged")]) == sum(again.values())
    run_again(call, tiny_run, work)
    assert stages(work.parent / "again", reused=False) == {}


@pytest.mark.parametrize("name", ["stage.json", "*.npz", "rgb.npy", "*.safetensors", "history.csv"])
def test_one_kind_of_file_damaged_in_all_ways(
    tiny_run: TinyRun, call: Call, work: Path, name: str
) -> None:
    """Only the stages that have such a file are made again."""
    files = [path for stage in MADE for path in sorted((work / stage).glob(f"*/{name}"))]
    for number, path in enumerate(files):
        damage([path], list(WAYS)[number % len(WAYS)])
    run_again(call, tiny_run, work)
    again = stages(work.parent / "again", reused=False)
    assert again.keys() == {path.parents[1].name for path in files}


@pytest.mark.parametrize("way", WAYS)
def test_a_damaged_database_does_not_stop_a_run(
    tiny_run: TinyRun, call: Call, work: Path, way: str
) -> None:
    damage([work / "mlflow.db"], way)
    run_again(call, tiny_run, work)
    assert stages(work.parent / "again", reused=False) == {}


def test_a_work_folder_may_be_moved_and_have_any_name(
    tiny_run: TinyRun, call: Call, work: Path
) -> None:
    moved = work.parent / "my wörk (2)"
    work.rename(moved)
    before = {path.name for path in (tiny_run.folder / "work" / "mlflow-artifacts").iterdir()}
    run_again(call, tiny_run, moved)
    assert stages(moved.parent / "again", reused=False) == {}
    after = {path.name for path in (tiny_run.folder / "work" / "mlflow-artifacts").iterdir()}
    assert after == before
