"""Finished runs and sweeps on disk, read back for figures and tables."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from hlp.reporting.figures.trade_off import SWEEP

MANIFEST = "manifest.json"
"""Of a run's folder, written last: a folder that has one holds a whole result."""
SUMMARY = "summary.json"
"""Of a folder of the method's own runs; what measures its stages writes none."""


@dataclass(frozen=True)
class Result:
    """One finished run: its whole configuration, `summary.json`, and the number of frames.

    `chosen` holds what was given on the command line, or by the sweep, as text.
    """

    config: Mapping[str, Any]
    summary: Mapping[str, Any]
    frames: int
    chosen: Mapping[str, str]

    @property
    def experiment(self) -> str:
        """Name of the experiment."""
        return str(self.config["name"])


@dataclass(frozen=True)
class ResultSet:
    """A sweep's finished arms, or one run that is no arm; how many arms are unfinished."""

    results: list[Result]
    swept: list[str]
    command: str
    unfinished: int


def result_folders(root: Path) -> list[Path]:
    """Folders in or below `root` that hold a sweep, or a run that is no sweep's arm."""
    sweeps = {path.parent for path in root.rglob(SWEEP)}
    runs = {path.parent for path in root.rglob(MANIFEST) if _is_finished(path.parent)}
    return sorted(sweeps | {run for run in runs if run.parent not in sweeps})


def read_results(folder: Path) -> ResultSet:
    """What a folder of `result_folders` holds, arms in their order.

    Raises ValueError for a broken file, naming the folder.
    """
    try:
        if (folder / SWEEP).is_file():
            return _read_sweep(folder)
        command = " ".join(["hlp run", *_overrides(folder)])
        return ResultSet([_read_run(folder)], [], command, 0)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{folder} holds no results that can be read ({error!r})") from error


def _read_sweep(folder: Path) -> ResultSet:
    sweep = json.loads((folder / SWEEP).read_text())
    arms = sorted((path for path in folder.iterdir() if path.name.isdigit()), key=_number)
    finished = [arm for arm in arms if _is_finished(arm)]
    command = " ".join(["hlp -m", *sweep["overrides"]])
    results = [_read_run(arm) for arm in finished]
    return ResultSet(results, sweep["swept"], command, len(arms) - len(finished))


def _read_run(folder: Path) -> Result:
    manifest = json.loads((folder / MANIFEST).read_text())
    summary = json.loads((folder / SUMMARY).read_text())
    pairs = (each.lstrip("+").split("=", 1) for each in _overrides(folder) if "=" in each)
    frames = len(manifest["data"]["keys"])
    return Result(manifest["config"], summary, frames, dict(pairs))


def _is_finished(folder: Path) -> bool:
    return all((folder / name).is_file() for name in (MANIFEST, SUMMARY))


def _overrides(folder: Path) -> list[str]:
    path = folder / ".hydra" / "overrides.yaml"
    given = yaml.safe_load(path.read_text()) if path.is_file() else []
    return [each for each in given if not each.startswith("output=")]


def _number(path: Path) -> int:
    return int(path.name)
