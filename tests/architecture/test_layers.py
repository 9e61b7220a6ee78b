"""What the design promises of imports; import-linter (`make check`) looks at their directions."""

import pkgutil
from itertools import cycle
from pathlib import Path

import pytest

import hlp
from hlp.commands.composing import compose_config
from hlp.config.composition import rows
from hlp.files import config_folder
from new_process import printed_by

SHOWN = ["run", "--cfg", "job", "data=bop", "data.root=X"]
HEAVY = ["torch", "pytorch_lightning", "lightning", "mlflow", "matplotlib", "trimesh"]
"""Libraries that take seconds to import."""
OF_RUNS = ["numba", "scipy", "onnxruntime", "faiss", "requests", "sqlalchemy"]
OF_SETTINGS = ["numpy", "cv2", "hydra", "omegaconf", "pydantic", "yaml", "jaxtyping"]


def without(*libraries: str) -> str:
    """Code that fails where one of these has been imported."""
    return f"import sys; found = {{*{libraries!r}}} & {{*sys.modules}}; assert not found, found"


def calling(arguments: list[str], *libraries: str) -> str:
    """Code that calls `hlp`, which must import none of these."""
    call = f"from hlp.cli import main\ntry: main({arguments!r})\nfinally:"
    return f"{call}\n    {without(*libraries)}"


@pytest.mark.slow  # torch and Lightning
def test_importing_does_nothing(tmp_path: Path) -> None:
    """Every module is imported in one fresh process, in an empty folder.

    All but `blinn_phong`, which is pyrender's code changed and so needs OpenGL; `opengl` imports it
    once rendering has started.
    """
    modules = [module.name for module in pkgutil.walk_packages(hlp.__path__, "hlp.")]
    modules.remove("hlp.rendering.blinn_phong")
    code = (
        "import importlib, os\n"
        "import cv2, numba, pytorch_lightning, scipy, threadpoolctl, torch, trimesh\n"  # set some
        "before = dict(os.environ)\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        "new = {key: value for key, value in os.environ.items() if before.get(key) != value}\n"
        "assert not new, f'importing sets {new}'\n"
        f"{without('mlflow', 'OpenGL')}\n"  # the one costs seconds, the other may be missing
        "assert not torch.cuda.is_initialized()"
    )
    assert printed_by(code, tmp_path, PYTHONDONTWRITEBYTECODE="1") == ""
    assert not list(tmp_path.iterdir()), "importing writes files"


def test_the_detector_is_imported_without_a_framework() -> None:
    """What `hlp.Detector` costs a robot's program: numpy, OpenCV, numba and this many modules."""
    heavy = [*HEAVY, "hydra", "omegaconf", "pyrender", "pyrealsense2"]
    count = printed_by(
        "import sys, hlp\n"
        "assert not any(name.startswith('hlp.') for name in sys.modules), 'loads more'\n"
        "hlp.Detector, hlp.Tracker, hlp.CameraImage\n"
        f"{without(*heavy)}\n"
        "print(sum(name.partition('.')[0] == 'hlp' for name in sys.modules))"
    )
    assert int(count) < 88


def test_predicting_imports_no_framework() -> None:
    """What a call with learnt objects imports: no training, no configuration, no tracking."""
    heavy = [*HEAVY, "hydra", "omegaconf", "pandas", "sklearn", "scipy.optimize"]
    printed_by(f"import hlp.cli, hlp.runs.prediction, hlp.runs.learnt_cache\n{without(*heavy)}")


@pytest.mark.parametrize(
    ("arguments", "heavy", "words"),
    [
        ([*SHOWN, "encoder=cae", "refinement=icp"], [*HEAVY, *OF_RUNS], "refinement"),
        (["run", "--help"], [*HEAVY, *OF_RUNS], "refinement"),
        (["-sc", "query=bash"], [*HEAVY, *OF_RUNS], "refinement"),
        (["--help"], [*HEAVY, *OF_RUNS, *OF_SETTINGS], "run"),
        (["runs", "--help"], [*HEAVY, *OF_RUNS, *OF_SETTINGS], "run"),
    ],
)
def test_what_only_shows_something_imports_little(
    arguments: list[str], heavy: list[str], words: str
) -> None:
    """Hydra and the settings' modules take a second; these libraries would take three more."""
    assert words in printed_by(calling(arguments, *heavy), COMP_LINE="hlp run refinem")


def test_the_names_of_commands_are_completed_at_once() -> None:
    code = calling(["-sc", "query=bash"], *HEAVY, *OF_RUNS, *OF_SETTINGS)
    assert "run" in printed_by(code, COMP_LINE="hlp ru")


def alternatives(group: str) -> list[str]:
    files = {path.stem for path in (config_folder() / group).glob("*.yaml")}
    return sorted(files | {*rows().get(group, {})})


PAIRS = list(zip(alternatives("experiment"), cycle(alternatives("data")), strict=False))


@pytest.mark.parametrize(("experiment", "data"), PAIRS)
def test_every_experiment_and_data_set_composes(experiment: str, data: str) -> None:
    """The other groups' alternatives are composed by the tests of settings."""
    assert {name for _, name in PAIRS} == {*alternatives("data")}
    config = compose_config(f"experiment={experiment}", f"data={data}", "output=out")
    assert config.name and config.data.name
