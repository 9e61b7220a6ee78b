"""Fixtures shared by all tests."""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # before torch is imported anywhere
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "200000000")  # as `hlp` does

import gc
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from jaxtyping import install_import_hook

# Shapes and types of the records that stages hand to each other are checked while tests run.
# jaxtyping's own option of pytest comes too late where a call names a folder with a conftest.py
# that imports them.
install_import_hook(["hlp.records", "hlp.geometry"], "beartype.beartype")

from hlp.cli import main
from hlp.config.composition import provide_defaults
from hlp.records import Mesh
from made_once import made_once
from refinement_scene import Scene, make_row, make_scene
from tiny_run import TINY, Call, TinyRun, make_tiny_run, run_here

# Properties: few examples, the same in every run; HLP_EXAMPLES=2000 tries that many new ones.
settings.register_profile(
    "fast",
    max_examples=20,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.register_profile(
    "thorough",
    settings.get_profile("fast"),
    max_examples=int(os.environ.get("HLP_EXAMPLES", "2000")),
    derandomize=False,
    print_blob=True,
)
settings.load_profile("thorough" if "HLP_EXAMPLES" in os.environ else "fast")

provide_defaults()  # to every configuration that a test composes


def pytest_collection_finish() -> None:
    """Garbage is not looked for in what all tests have imported, which would take a second."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def symmetries() -> Iterator[None]:
    """The symmetries of a mesh, which take a second, are looked for once by each process."""
    from hlp.objects import near_symmetries

    find, found = near_symmetries.find_near_symmetries, {}

    def find_once(mesh: Mesh, diameter: float) -> near_symmetries.NearSymmetries:
        arrays = (mesh.vertices, mesh.faces, mesh.colors)
        key = (*(None if array is None else array.tobytes() for array in arrays), diameter)
        if key not in found:
            found[key] = find(mesh, diameter)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(near_symmetries, "find_near_symmetries", find_once)
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the public development data; tests that need it are skipped where it is absent."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not (folder / "lm").is_dir():
        pytest.skip(f"development data is absent: no {folder / 'lm'}")
    return folder


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory: pytest.TempPathFactory) -> TinyRun:
    """A tiny run that tests look at, and whose stages they use again."""
    return make_tiny_run(tmp_path_factory, "tiny_run", lambda _: TINY)


@pytest.fixture
def terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> pytest.CaptureFixture[str]:
    """`capsys`, with streams that say that they are a terminal."""
    # Of the class, since the test itself has other streams than its fixtures.
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda self: True)
    return capsys


@pytest.fixture(scope="session")
def learnt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of the demo's bear and can, learnt in seconds."""

    def make(folder: Path) -> None:
        from hlp import Detector
        from tiny_method import tiny_method, write_meshes

        meshes = write_meshes(folder, "bear", "can")
        Detector.learn(meshes, folder / "objects", settings=tiny_method())

    return made_once(tmp_path_factory, "learnt", make) / "objects"


@pytest.fixture
def threads() -> Iterator[None]:
    """What a test sets the number of threads of torch and OpenCV to is undone."""
    import cv2
    import torch

    number = torch.get_num_threads()
    yield
    torch.set_num_threads(number)
    cv2.setNumThreads(-1)


@pytest.fixture
def call(tiny_run: TinyRun, monkeypatch: pytest.MonkeyPatch) -> Call:
    """`hlp run` in this process and the tiny run's folder: exit code, standard output and error."""
    monkeypatch.chdir(tiny_run.folder)
    return run_here


@pytest.fixture
def fails(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """A command that must fail: its words -> the one line that it says."""

    def line_of(*words: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 1
        (line,) = capsys.readouterr().err.splitlines()
        return str(line)

    return line_of


@pytest.fixture(scope="session")
def scene() -> Scene:
    """An object on a table, for the tests of refinement."""
    return make_scene(0)


@pytest.fixture(scope="session")
def row() -> list[Scene]:
    """Three instances beside each other."""
    return make_row()
