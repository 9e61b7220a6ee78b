"""The smallest run of the demo world, shared by the tests that look at runs."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

import hlp
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
    "patches.pool.per_object=60",
    "patches.pool.backgrounds=120",
    "patches.pool.distractor_scenes=2",
    "patches.pairs.per_object=60",
    "classifier.epochs=1",
    "classifier.min_batches=0",
    "score.scenes=0",
    "voting.hypotheses=12",
    "refinement.verification.candidates=4",
    "frames=2",
    "panels=1",
)


@dataclass(frozen=True)
class TinyRun:
    """A finished run of the demo world, everything as small as it can be.

    `overrides` are what `hlp run` was given beside `output`; stages lie in `folder`/work. It may be
    a copy of `made_in`, where the run took place.
    """

    folder: Path
    output: Path
    overrides: tuple[str, ...]
    process: "subprocess.CompletedProcess[str]"
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
        done = start_run(folder, *overrides(folder), "output=first", threads=2)
        assert done.returncode == 0, done.stderr
        said = [done.stdout, done.stderr, str(folder)]
        (folder / "said.json").write_text(json.dumps(said))

    folder = made_once(factory, name, make)
    out, err, made_in = json.loads((folder / "said.json").read_text())
    process = subprocess.CompletedProcess([], 0, out, err)
    return TinyRun(folder, folder / "first", overrides(Path(made_in)), process, Path(made_in))


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
