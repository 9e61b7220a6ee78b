"""`hlp` in the tests' own process."""

import logging
import os
import sys
from collections.abc import Callable, Iterator

import cv2
import pytest
import torch

from hlp.cli import main
from tiny_run import TinyRun

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def call(
    tiny_run: TinyRun, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Call]:
    """`hlp run` in this process and the tiny run's folder: exit code, standard output and error."""
    root = logging.getLogger()
    handlers, level, threads = root.handlers[:], root.level, torch.get_num_threads()
    variables = dict(os.environ)
    monkeypatch.setattr(sys, "argv", sys.argv)
    monkeypatch.chdir(tiny_run.folder)

    def run(*overrides: str) -> tuple[int, str, str]:
        capsys.readouterr()
        try:
            main(["run", *overrides])
            code = 0
        except SystemExit as exit_:
            code = int(exit_.code or 0)
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    yield run
    root.handlers[:] = handlers
    root.setLevel(level)
    torch.set_num_threads(threads)
    cv2.setNumThreads(-1)
    for name in set(os.environ) - set(variables):
        del os.environ[name]
    os.environ.update(variables)
