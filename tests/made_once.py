"""What takes long to make and several test processes need: made once, copied for each."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """An own folder with what `make` writes into the folder that it is given.

    The test processes of one call (pytest-xdist) share a folder above their own ones.
    """
    own = factory.mktemp(name)
    if "PYTEST_XDIST_WORKER" not in os.environ:
        make(own)
        return own
    shared = factory.getbasetemp().parent / name
    finished = Path(f"{shared}.finished")
    with FileLock(f"{shared}.lock"):
        if not finished.is_file():
            shutil.rmtree(shared, ignore_errors=True)
            shared.mkdir()
            make(shared)  # not renamed afterwards: some of it names its own folder
            finished.touch()
    shutil.copytree(shared, own, dirs_exist_ok=True, symlinks=True)
    return own
