"""The wheel, installed without the checkout, used from an empty folder by someone with no home."""

import json
import re
import sys
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from made_once import made_once
from notebook_runs import execute, pictures, printed
from run_files import read_json
from table_text import unpadded
from tiny_method import TINY as TINY_METHOD
from tiny_run import TINY
from wheel_folder import CHECKOUT, WheelFolder, install_wheel

pytestmark = pytest.mark.slow

OUT = "outputs/mine"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The installed wheel, and a run of the user's own experiment in the empty folder."""
    return WheelFolder(made_once(tmp_path_factory, "wheel", _install_and_run))


def _install_and_run(folder):
    wheel = install_wheel(folder)
    _write_experiment(wheel.place / "my_conf" / "experiment" / "mine.yaml")
    own = ("--config-dir", "my_conf", "experiment=mine", f"output={OUT}", "machine.threads=1")
    ran = wheel.hlp("run", *own)
    copied = wheel.hlp("notebooks")
    said = {"run": (ran.returncode, ran.stderr), "notebooks": (copied.returncode, copied.stderr)}
    (folder / "said.json").write_text(json.dumps(said))


def _write_experiment(path):
    path.parent.mkdir(parents=True)
    values = OmegaConf.from_dotlist([setting for setting in TINY if setting != "encoder=pca"])
    content = {"defaults": [{"override /encoder": "pca"}, "_self_"], "name": "mine", **values}
    path.write_text("# @package _global_\n" + OmegaConf.to_yaml(content))


def test_it_holds_configuration_and_notebooks_and_nothing_else_of_the_checkout(wheel):
    inside = {path.name for path in wheel.package.iterdir()}
    assert {name for name in inside if not name.endswith(".dist-info")} == {"hlp", "bin"}
    for folder, files in (("conf", "*.yaml"), ("notebooks", "*.ipynb")):
        shipped, ours = wheel.package / "hlp" / folder, CHECKOUT / folder
        assert {path.relative_to(shipped) for path in shipped.rglob(files)} == {
            path.relative_to(ours) for path in ours.rglob(files)
        }
    done = wheel.call(sys.executable, "-c", "import hlp; print(hlp.__file__)")
    assert Path(done.stdout.strip()).is_relative_to(wheel.package)


def test_help_and_configuration(wheel):
    assert "usage: hlp COMMAND" in wheel.printed_by_hlp("--help")
    assert "\nrefinement:\n" in wheel.printed_by_hlp("run", "--cfg", "job")


def test_the_example_is_found(wheel):
    wheel.printed_by_hlp("predict", "learnt=example", "output=outputs/example")
    assert (wheel.place / "outputs/example/panels/000000.png").is_file()


def test_a_users_own_experiment_runs_without_a_home(wheel):
    code, said = read_json(wheel.folder / "said.json")["run"]
    assert code == 0, said
    out = wheel.place / OUT
    assert read_json(out / "manifest.json")["config"]["name"] == "mine"
    assert read_json(out / "summary.json")["targets"] > 0
    assert "<html" in (out / "report.html").read_text()
    made = {path.name for path in wheel.place.iterdir()}
    assert made <= {"my_conf", "outputs", "work", "notebooks"}


def test_nothing_is_written_into_the_package(wheel):
    record = next(wheel.package.glob("hlp-*.dist-info")) / "RECORD"
    listed = {line.split(",")[0].removeprefix("../../") for line in record.read_text().split("\n")}
    assert {str(path.relative_to(wheel.package)) for path in wheel.files()} <= listed


def test_the_run_is_listed_and_reported_again(wheel):
    assert "mine" in wheel.printed_by_hlp("runs")
    (wheel.place / OUT / "report.html").unlink()
    wheel.printed_by_hlp("report", f"output={OUT}")
    assert (wheel.place / OUT / "report.html").is_file()


@pytest.fixture
def notebooks(wheel, monkeypatch):
    """The folder of the user's copies, beside the work and the outputs of the run."""
    code, said = read_json(wheel.folder / "said.json")["notebooks"]
    assert code == 0, said
    monkeypatch.setenv("PYTHONPATH", str(wheel.package))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel draws into the notebook
    return wheel.place / "notebooks"


def test_the_method_is_shown_stage_by_stage(notebooks):
    overrides = [setting for setting in TINY if not setting.startswith("panels")]
    parameters = f"OVERRIDES = {overrides}\nWORK = '../work'\nFRAME = 0"
    before = set((notebooks.parent / "work").glob("*/*"))
    done = execute(notebooks / "01_method.ipynb", parameters)
    shown = pictures(done)
    assert len(shown) == 8  # frame, views, region, patches, distances, votes, swarm, panels
    assert all(picture.std() > 10 for picture in shown)
    text = printed(done)
    assert re.search(r"hypothesis \d+: coarse cost ", text)
    assert "fine   cost " in text
    assert set((notebooks.parent / "work").glob("*/*")) == before  # it found what was learnt


def test_runs_are_read_from_outputs_and_mlflow(notebooks):
    parameters = "OUTPUTS = '../outputs'\nDATABASE = '../work/mlflow.db'\nEXPERIMENT = 'mine'"
    done = execute(notebooks / "02_runs.ipynb", parameters)
    text = unpadded(printed(done))
    assert "| mine |" in text
    assert "| all targets |" in text
    assert "| add |" in text
    assert "FINISHED" in text
    assert len(pictures(done)) == 5  # recalls, misses, calibration, all poses of a frame, panels


def test_an_own_object_is_learnt_loaded_found_and_drawn(notebooks):
    parameters = f"OVERRIDES = {[*TINY_METHOD, 'machine.threads=1']}\nFOLDER = 'own'"
    done = execute(notebooks / "03_own_object.ipynb", parameters)
    text = printed(done)
    assert "bear: score " in text
    assert "bear: " in text.partition("ADD-S")[2]  # the reason of the rejection, after the answer
    errors = re.findall(r"ADD-S ([\d.]+) mm of ([\d.]+) mm", text)
    assert errors and float(errors[0][0]) < float(errors[0][1])
    assert len(pictures(done)) == 2  # the frame, the answer
    assert {path.name for path in (notebooks / "own").iterdir()} >= {"bear.ply", "learnt"}


def test_ablations_sweep_and_show_tables_and_figures(notebooks):
    parameters = (
        "FIGURE = ['experiment=fig9b', 'refinement.particles=5,25']\n"
        "OWN = ['refinement=pso,none']\n"
        f"COMMON = {[*TINY, 'machine.threads=2']}\n"
        "WORK = '../work'\nOUTPUTS = 'ablations'"
    )
    done = execute(notebooks / "04_ablations.ipynb", parameters)
    text = unpadded(printed(done))
    assert "hlp -m experiment=fig9b" in text
    assert "fig9b.svg" in text and "report.html" in text
    assert "2 of 2 runs finished" in text
    assert "| refinement |" in text
    assert len(pictures(done)) == 2
