"""The smallest run of the demo world, shared by the tests that look at runs."""

import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest

import hlp
from hlp.cli import main
from hlp.commands.composing import compose_config
from hlp.config.build import Run, build_run
from made_once import made_once

Call = Callable[..., tuple[int, str, str]]
"""`hlp run` in this process: overrides -> exit code, standard output and error."""

TINY = (
    "encoder=pca",
    "data.width=320",
    "data.height=240",
    "data.objects=[5,5]",
    "data.clutter=[1,3]",
    "data.background_frames=4",
    "rendering.viewpoints=20",
    "rendering.in_plane_steps=3",
    "rendering.size_px=64",
    "patches.pool.per_object=60",
    "patches.pool.backgrounds=120",
    "patches.pool.distractor_scenes=2",
    "patches.pairs.per_object=60",
    "classifier.epochs=1",
    "classifier.min_batches=0",
    "voting.hypotheses=12",
    "refinement.verification.candidates=4",
    "frames=2",
    "panels=1",
)


@dataclass(frozen=True)
class TinyRun:
    """A finished run of the demo world, everything as small as it can be.

    `overrides` are what `hlp run` was given beside `output`, `out` and `error` what it printed;
    stages lie in `folder`/work. It may be a copy of `made_in`, where the run took place.
    """

    folder: Path
    output: Path
    overrides: tuple[str, ...]
    out: str
    error: str
    made_in: Path

    def build(self, *overrides: str) -> Run:
        """The run's configuration with other overrides, ready to work in the same folder."""
        work = f"work={self.folder / 'work'}"
        return build_run(compose_config(*self.overrides, work, "output=out", *overrides))


def make_tiny_run(
    factory: pytest.TempPathFactory, name: str, overrides: Callable[[Path], tuple[str, ...]]
) -> TinyRun:
    """The run with these overrides, once for all test processes."""

    def make(folder: Path) -> None:
        with chdir(folder):
            code, *said = run_here(*overrides(folder), "output=first", "machine.threads=2")
        assert code == 0, said
        (folder / "said.json").write_text(json.dumps([*said, str(folder)]))

    folder = made_once(factory, name, make)
    out, err, made_in = json.loads((folder / "said.json").read_text())
    return TinyRun(folder, folder / "first", overrides(Path(made_in)), out, err, Path(made_in))


def run_here(*overrides: str) -> tuple[int, str, str]:
    """`hlp run` in this process, which has imported everything: exit code, output and errors."""
    out, error = StringIO(), StringIO()
    with left_as_it_was(), redirect_stdout(out), redirect_stderr(error):
        try:
            main(["run", *overrides])
            code = 0
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, out.getvalue(), error.getvalue()


@contextmanager
def left_as_it_was() -> Iterator[None]:
    """Arguments, variables, logging and threads of this process are as before afterwards."""
    import cv2
    import torch

    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    arguments, variables, threads = sys.argv, dict(os.environ), torch.get_num_threads()
    try:
        yield
    finally:
        for handler in {*root.handlers} - {*handlers}:
            handler.close()
        root.handlers[:] = handlers
        root.setLevel(level)
        sys.argv = arguments
        for name in {*os.environ} - {*variables}:
            del os.environ[name]
        os.environ.update(variables)
        torch.set_num_threads(threads)
        cv2.setNumThreads(-1)


def start_run(folder: Path, *overrides: str, threads: int) -> "subprocess.CompletedProcess[str]":
    """`hlp run` in a process of its own, all its libraries with so many threads."""
    return start_hlp(folder, "run", *overrides, f"machine.threads={threads}")


def start_hlp(
    folder: Path, *arguments: str, environment: Mapping[str, str | None] | None = None
) -> "subprocess.CompletedProcess[str]":
    """`hlp` in a process of its own, with these variables, or without those that are None."""
    # `machine.threads` decides
    unset = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"))
    own = {"PYTHONPATH": str(Path(hlp.__file__).parents[1]), **unset, **(environment or {})}
    variables = {**os.environ, **own}
    return subprocess.run(
        [sys.executable, "-c", "from hlp.cli import main; main()", *arguments],
        cwd=folder,
        env={name: value for name, value in variables.items() if value is not None},
        capture_output=True,
        text=True,
        check=False,
    )
