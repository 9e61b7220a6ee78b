"""Sweeps of runs and of studies as `hlp -m` leaves them, written by hand."""

import json
from pathlib import Path
from typing import Any

from hlp.records import TargetScore
from hlp.reporting.sweeps import Sweep, read_sweeps
from hlp.results.poses_file import write_scores
from written_results import scored, write_run, write_sweep

PARTICLES = "refinement.particles"


def only(folder: Path) -> Sweep:
    (found,) = read_sweeps(folder)
    return found


def change(path: Path, **values: Any) -> None:
    """Replace values of a JSON file."""
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


def set_default(folder: Path, particles: str) -> None:
    change(folder / "sweep.json", defaults={PARTICLES: particles})


def begin(folder: Path, *overrides: str) -> Path:
    (folder / ".hydra").mkdir(parents=True)
    (folder / ".hydra" / "overrides.yaml").write_text(json.dumps(overrides))
    return folder


def write_scored(folder: Path, chosen: dict[str, str], right: int, ms: float) -> None:
    """A run of twenty targets in ten frames of which so many are right, the first ones."""
    overrides = [f"{key}={value}" for key, value in chosen.items()]
    write_run(folder, "demo", scored(right / 20, ms, {"cat": right / 20}), overrides)
    scores = [
        TargetScore(1, i // 2, 6, True, 1.0, 0.01, 0.1, 0.01, 0.9, i < right, True, True)
        for i in range(20)
    ]
    write_scores(folder / "scores.csv", scores, {6: "cat"})


def write_three_runs(folder: Path) -> Path:
    """A sweep of three runs: the second is the default; the third has failed."""
    write_sweep(folder, [PARTICLES], [f"{PARTICLES}=5,25,50"])
    set_default(folder, "25.0")
    write_scored(folder / "0", {PARTICLES: "5"}, 12, 30.0)
    write_scored(folder / "1", {PARTICLES: "25"}, 18, 50.0)
    begin(folder / "2", f"{PARTICLES}=50")
    return folder
