"""With compiled kernels, requirements-detect.txt is enough to find learnt objects."""

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh

from frame_files import write_camera, write_image
from hlp import Detector
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from table_text import csv_rows
from tiny_method import tiny_method, write_meshes
from wheel_folder import CHECKOUT, WheelFolder, install_wheel

GIVEN = ("rgb=rgb", "depth=depth", "intrinsics=camera.json", "min_score=0")


def pinned(path: Path) -> dict[str, str]:
    """The exact versions in a file of requirements, by name."""
    lines = [line.partition(" ;")[0].partition("==") for line in path.read_text().splitlines()]
    return {name: version for name, _, version in lines if version}


def test_it_holds_what_pyproject_names_in_the_versions_that_are_tested():
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    named = {*project["dependency-groups"]["detect"]}
    stated = {
        line.partition(">")[0].partition("=")[0] for line in project["project"]["dependencies"]
    }
    detect = pinned(CHECKOUT / "requirements-detect.txt")
    tested = pinned(CHECKOUT / "constraints.txt")
    assert named <= stated and named <= detect.keys()
    assert {name: tested.get(name, version) for name, version in detect.items()} == detect
    assert not {"torch", "mlflow", "hydra-core", "pyrender", "numba", "scipy"} & detect.keys()


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> tuple[WheelFolder, str]:
    """The wheel without its dependencies, and a Python that has those of the file alone."""
    wheel = install_wheel(tmp_path_factory.mktemp("wheel"), HLP_COMPILE="1")
    subprocess.run([sys.executable, "-m", "venv", wheel.folder / "venv"], check=True)
    python = str(wheel.folder / "venv" / "bin" / "python")
    needed = str(CHECKOUT / "requirements-detect.txt")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "-r", needed], check=True)
    return wheel, python


@pytest.fixture(params=["coloured", "colourless"])
def objects(request, learnt, tmp_path) -> Path:
    """Learnt objects with colours, or one without: that is looked for by templates, too."""
    if request.param == "coloured":
        return learnt
    ((name, path),) = write_meshes(tmp_path, "can").items()
    mesh = trimesh.load(path)
    trimesh.Trimesh(mesh.vertices, mesh.faces).export(path)
    Detector.learn({name: path}, tmp_path / "grey", settings=tiny_method())
    return tmp_path / "grey"


def sure(rows: list[dict[str, str]]) -> list[np.ndarray]:
    """Where the objects are (mm), of which the score is at least a half."""
    return [np.array(row["t"].split(), float) for row in rows if float(row["score"]) >= 0.5]


@pytest.mark.slow
def test_objects_are_found_with_it_alone_as_with_everything(installed, objects, tmp_path):
    wheel, python = installed
    scenes = SyntheticScenes(SyntheticSettings(width=320, height=240, objects=(5, 5)))
    for key in scenes.keys[:2]:
        frame = scenes.load(key)
        write_image(wheel.place, str(key), frame)
    write_camera(wheel.place, frame)
    checkout = {"PYTHONPATH": str(CHECKOUT / "src")}  # where numba compiles
    found = []
    for k, (name, more) in enumerate(
        [(python, {}), (sys.executable, {}), (sys.executable, checkout)]
    ):
        output = tmp_path / str(k)
        call = [name, "-m", "hlp", "predict", f"learnt={objects}", *GIVEN, f"output={output}"]
        env = {**wheel.variables, **more}
        done = subprocess.run(
            call, cwd=wheel.place, env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        found.append(
            [
                {key: row[key] for key in ("obj_id", "score", "R", "t")}
                for row in csv_rows(output / "poses.csv")
            ]
        )
    assert found[0] == found[1] and sure(found[1])
    # Other vector instructions add in another order.
    for one, other in zip(*map(sure, found[1:]), strict=True):
        np.testing.assert_allclose(one, other, atol=0.5)  # mm


@pytest.mark.slow
def test_what_needs_more_says_so_in_a_line(installed):
    wheel, python = installed
    write_meshes(wheel.place, "bear")
    done = wheel.call(python, "-m", "hlp", "learn", "mesh=bear.ply", "output=l")
    assert done.returncode == 1
    assert "is not installed" in done.stderr and done.stderr.count("\n") == 1
