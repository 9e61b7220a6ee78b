"""The smallest run of the demo world, shared by the tests that look at runs."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import hlp

TINY = (
    "encoder=pca",
    "data.width=320",
    "data.height=240",
    "data.objects=[5,5]",
    "data.clutter=[1,3]",
    "rendering.viewpoints=24",
    "rendering.in_plane_steps=3",
    "patches.pool.per_object=60",
    "patches.pool.backgrounds=120",
    "patches.pool.distractor_scenes=2",
    "patches.pairs.per_object=60",
    "classifier.epochs=1",
    "classifier.min_batches=0",
    "score.scenes=0",
    "voting.hypotheses=16",
    "refinement.verification.candidates=6",
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


def start_run(folder: Path, *overrides: str, threads: int) -> "subprocess.CompletedProcess[str]":
    """`hlp run` in a process of its own, all its libraries with so many threads."""
    command = [sys.executable, "-c", "from hlp.cli import main; main()", "run"]
    environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        environment.pop(variable, None)  # `machine.threads` decides
    return subprocess.run(
        [*command, *overrides, f"machine.threads={threads}"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
