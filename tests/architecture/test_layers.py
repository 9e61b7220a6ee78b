"""What the design promises of the code as a whole."""

import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

import hlp
from hlp.commands.composing import config_folder

ROOT = Path(__file__).parents[2]


def test_imports_keep_to_the_layers() -> None:
    # In a process of its own: import-linter disables all loggers of the one it runs in.
    command = [sys.executable, "-c", "import importlinter.cli as c; c.lint_imports_command()"]
    done = subprocess.run([*command, "--no-cache"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_importing_does_nothing(tmp_path: Path) -> None:
    """Every module is imported in one fresh process, in an empty folder.

    All but `blinn_phong`, which is pyrender's code changed and so needs OpenGL; `opengl` imports it
    once rendering has started.
    """
    found = [each.name for each in pkgutil.walk_packages(hlp.__path__, "hlp.")]
    modules = [name for name in found if name != "hlp.rendering.blinn_phong"]
    assert "hlp.stages.store" in modules
    code = (
        "import importlib, os\n"
        "import cv2, numba, pytorch_lightning, scipy, threadpoolctl, torch, trimesh\n"  # set some
        "before = dict(os.environ)\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        "new = {key: value for key, value in os.environ.items() if before.get(key) != value}\n"
        "assert not new, f'importing sets {new}'\n"
        "import sys\n"
        "assert 'mlflow' not in sys.modules, 'mlflow costs seconds: import it where it is used'\n"
        "assert 'OpenGL' not in sys.modules, 'OpenGL may be missing: import it where it is used'\n"
        "assert not torch.cuda.is_initialized()\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert not list(tmp_path.iterdir()), "importing writes files"


def test_the_detector_is_imported_without_a_framework() -> None:
    """What `hlp.Detector` costs a robot's program: numpy, OpenCV, numba and this many modules."""
    code = (
        "import sys, hlp\n"
        "assert not any(name.startswith('hlp.') for name in sys.modules), 'loads more'\n"
        "hlp.Detector, hlp.Tracker, hlp.CameraImage\n"
        "heavy = {'torch', 'pytorch_lightning', 'lightning', 'mlflow', 'hydra', 'omegaconf',"
        " 'matplotlib', 'trimesh', 'pyrender', 'pyrealsense2'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "print(sum(name.partition('.')[0] == 'hlp' for name in sys.modules))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 87


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "--cfg", "job"],
        ["run", "--cfg", "job", "data=bop", "data.root=X", "encoder=cae", "refinement=icp"],
        ["run", "--help"],
        ["-sc", "query=bash"],
    ],
    ids=" ".join,
)
def test_what_only_shows_settings_imports_nothing_heavy(arguments: list[str]) -> None:
    """Hydra and the settings' modules take a second; these libraries would take three more."""
    code = (
        "import sys\n"
        "from hlp.cli import main\n"
        "try:\n"
        f"    main({arguments!r})\n"
        "finally:\n"
        "    heavy = {'torch', 'pytorch_lightning', 'lightning', 'mlflow', 'matplotlib', 'numba',"
        " 'scipy', 'trimesh', 'onnxruntime', 'faiss', 'requests', 'sqlalchemy'}\n"
        "    assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "COMP_LINE": "hlp run refinem"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "refinement" in done.stdout


def test_a_configuration_whose_defaults_are_kept_is_shown_without_arrays(tmp_path: Path) -> None:
    """NumPy and the settings' classes would take a third of a second."""
    code = (
        "import sys\n"
        "from hlp.cli import main\n"
        "main(['run', '--cfg', 'job', 'data=bop', 'data.root=X'])\n"
        "print('imported', 'numpy' in sys.modules)\n"
    )
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT / "src"), "XDG_CACHE_HOME": str(tmp_path)
    }  # fmt: skip
    first, second = (
        subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for _ in range(2)
    )
    assert first == second.replace("imported False", "imported True") != second


@pytest.mark.parametrize("arguments", [["--help"], ["runs", "--help"], ["-sc", "query=bash"]])
def test_what_answers_at_once_imports_none_of_the_libraries(arguments: list[str]) -> None:
    code = (
        "import sys\n"
        "from hlp.cli import main\n"
        f"main({arguments!r})\n"
        "heavy = {'numpy', 'cv2', 'hydra', 'omegaconf', 'pydantic', 'yaml', 'jaxtyping', 'torch',"
        " 'mlflow', 'numba', 'scipy', 'matplotlib'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "COMP_LINE": "hlp ru"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "run" in done.stdout


def alternatives() -> list[str]:
    """Files that a group chooses from; the arms of the ladder are whole experiments."""
    found = config_folder().glob("*/*.yaml")
    return sorted(
        f"{path.parent.name}={path.stem}"
        for path in found
        if path.stem[0] != "_" and path.parent.name != "ladder"
    )


@pytest.mark.parametrize("choice", alternatives())
def test_every_alternative_composes_and_bears_a_name(choice: str) -> None:
    with initialize_config_dir(str(config_folder().absolute()), version_base="1.3"):
        config = compose("config", overrides=[choice])
    group = choice.partition("=")[0]
    if group not in {"method", "experiment"}:
        assert config[group].name
