"""Fixtures shared by all tests."""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # before torch is imported anywhere

from pathlib import Path

import pytest

from hlp.config.typed_defaults import provide_defaults
from tiny_run import TINY, TinyRun, start_run

provide_defaults()  # to every configuration that a test composes


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
    folder = tmp_path_factory.mktemp("tiny_run")
    process = start_run(folder, *TINY, "output=first", threads=2)
    assert process.returncode == 0, process.stderr
    return TinyRun(folder, folder / "first", TINY, process)
