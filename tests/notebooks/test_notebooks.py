"""The notebooks run from first cell to last, on the tiny run of the demo world."""

import re
from pathlib import Path

import nbformat
import pytest

import hlp
from notebook_runs import NOTEBOOKS, execute, pictures, printed
from table_text import unpadded
from tiny_method import TINY as TINY_METHOD
from tiny_run import TinyRun


@pytest.fixture(autouse=True)
def package_on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(hlp.__file__).parents[1]))
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel draws into the notebook


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_committed_without_outputs(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.slow
def test_method_shows_every_stage(tiny_run: TinyRun) -> None:
    overrides = [each for each in tiny_run.overrides if not each.startswith("panels")]
    parameters = f"OVERRIDES = {overrides}\nWORK = 'work'\nFRAME = 0"
    before = set((tiny_run.folder / "work").glob("*/*"))
    done = execute(NOTEBOOKS / "01_method.ipynb", parameters, tiny_run.folder)
    shown = pictures(done)
    assert len(shown) == 7  # frame, views, region, patches, distances, votes, panels
    assert all(picture.std() > 10 for picture in shown)
    text = printed(done)
    assert re.search(r"hypothesis \d+: coarse cost ", text)
    assert "fine   cost " in text
    assert set((tiny_run.folder / "work").glob("*/*")) == before  # it found what was learnt


@pytest.mark.slow
def test_runs_are_read_from_outputs_and_mlflow(tiny_run: TinyRun) -> None:
    parameters = "OUTPUTS = '.'\nDATABASE = 'work/mlflow.db'\nEXPERIMENT = 'demo'"
    done = execute(NOTEBOOKS / "02_runs.ipynb", parameters, tiny_run.folder)
    text = unpadded(printed(done))
    assert "| first |" in text
    assert "| all targets |" in text
    assert "| add |" in text
    assert "FINISHED" in text
    assert len(pictures(done)) == 4  # recalls, errors, all poses of a frame, panels


@pytest.mark.slow
def test_own_object_is_learnt_loaded_found_and_drawn(tmp_path: Path) -> None:
    parameters = f"OVERRIDES = {[*TINY_METHOD, 'machine.threads=1']}\nFOLDER = 'own'"
    done = execute(NOTEBOOKS / "03_own_object.ipynb", parameters, tmp_path)
    text = printed(done)
    assert "bear: score " in text
    assert "bear: " in text.partition("ADD-S")[2]  # the reason of the rejection, after the answer
    errors = re.findall(r"ADD-S ([\d.]+) mm of ([\d.]+) mm", text)
    assert errors and float(errors[0][0]) < float(errors[0][1])
    assert len(pictures(done)) == 2  # the frame, the answer
    assert {path.name for path in (tmp_path / "own").iterdir()} >= {"bear.ply", "learnt"}


@pytest.mark.slow
def test_ablations_sweep_and_show_tables_and_figures(tiny_run: TinyRun) -> None:
    particles = "refinement.particles=5,25"
    parameters = (
        f"FIGURE = ['experiment=fig9b', '{particles}']\n"
        "OWN = ['refinement=pso,none']\n"
        f"COMMON = {[*tiny_run.overrides, 'machine.threads=2']}\n"
        "WORK = 'work'\nOUTPUTS = 'ablations'"
    )
    done = execute(NOTEBOOKS / "04_ablations.ipynb", parameters, tiny_run.folder)
    text = unpadded(printed(done))
    assert "hlp -m experiment=fig9b" in text
    assert "fig9b.svg" in text and "report.html" in text
    assert "2 of 2 arms finished" in text
    assert "| refinement |" in text
    assert len(pictures(done)) == 2
