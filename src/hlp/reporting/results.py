"""Finished runs and sweeps, read back from their folders for figures and tables."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from hlp.errors import DataError
from hlp.files import MANIFEST, SCORES, SUMMARY, SWEEP
from hlp.reporting.comparison import WELL_VISIBLE, ScoredTarget, read_targets
from hlp.results.recalls import TargetKey, read_summary
from hlp.settings import Stored, read_as, shown


@dataclass(frozen=True)
class ManifestData(Stored):
    """The part of a manifest that names the frames; `frames` is the hash of their content."""

    keys: list[str]
    frames: str = ""


@dataclass(frozen=True)
class Manifest(Stored):
    """manifest.json of a run."""

    config: dict[str, Any]
    data: ManifestData


@dataclass(frozen=True)
class _Sweep(Stored):
    """sweep.json."""

    overrides: list[str]
    swept: list[str]
    defaults: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Result:
    """One finished run: its whole configuration, its `summary.json`, and the number of frames.

    `chosen` holds the overrides given on the command line or by the sweep, as text by key. `folder`
    is where the run's files are. `frames_identity` is the hash of all frames of the data set.
    """

    config: Mapping[str, Any]
    summary: Mapping[str, Any]
    frames: int
    chosen: Mapping[str, str]
    folder: Path = Path()
    frames_identity: str = ""

    @property
    def experiment(self) -> str:
        """Name of the experiment."""
        return str(self.config["name"])

    @property
    def seed(self) -> str:
        """The seed of everything that is random."""
        return str(self.chosen.get("seed", self.config.get("seed", 0)))

    @cached_property
    def scores(self) -> Mapping[TargetKey, ScoredTarget]:
        """The scored targets; empty if they were removed."""
        path = self.folder / SCORES
        return read_targets(path) if path.is_file() else {}

    @property
    def verdicts(self) -> dict[TargetKey, float]:
        """1 for each target that is right by ADD(-S), 0 for each other."""
        return {key: float(target.correct("add")) for key, target in self.scores.items()}

    @property
    def hidden_targets(self) -> list[ScoredTarget]:
        """The targets that are not well visible."""
        scored = self.scores.values()
        return [found for found in scored if found.score.visible_fraction < WELL_VISIBLE]

    def in_words(self, keys: Sequence[str]) -> str:
        """The chosen values of some keys, e.g. `particles 25, seed 1`."""
        chosen = (key for key in keys if key in self.chosen)
        return ", ".join(f"{key.rpartition('.')[2]} {self.chosen[key]}" for key in chosen)

    @property
    def targets(self) -> int:
        """Number of targets."""
        return int(self.summary["targets"])

    @property
    def add(self) -> Mapping[str, Any]:
        """`recall` by ADD(-S) and its interval `ci95`."""
        metric: Mapping[str, Any] = self.summary["metrics"]["add"]
        return metric

    @property
    def total_ms(self) -> Mapping[str, float]:
        """`median` and `p95` of the time of one object in one frame (ms)."""
        times: Mapping[str, float] = self.summary["timing_ms"]["total"]
        return times


@dataclass(frozen=True)
class ResultSet:
    """The finished runs of a sweep, or a single run.

    `chosen` are the overrides of all runs by folder, `unfinished` the folders of those that are not
    finished (studies such as `hlp bench` are finished, though they have no summary and are no
    results); `defaults` the values of the swept keys without the sweep, where they are known.
    """

    results: list[Result]
    swept: list[str]
    command: str
    chosen: Mapping[Path, Mapping[str, str]] = field(default_factory=dict)
    unfinished: Sequence[Path] = ()
    defaults: Mapping[str, str] = field(default_factory=dict)


def result_folders(root: Path) -> list[Path]:
    """Folders in or below `root` that hold a sweep, or a run that belongs to no sweep."""
    sweeps = {path.parent for path in root.rglob(SWEEP)}
    runs = {path.parent for path in root.rglob(MANIFEST) if _is_finished(path.parent)}
    return sorted(sweeps | {run for run in runs if run.parent not in sweeps})


def read_results(folder: Path) -> ResultSet:
    """The results in a folder of `result_folders`, in the order of the sweep.

    Raises DataError for a broken file, naming the folder.
    """
    try:
        if (folder / SWEEP).is_file():
            return _read_sweep(folder)
        return ResultSet([_read_run(folder)], [], run_command(folder))
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{folder} holds no results that can be read ({error!r})") from error


def run_command(folder: Path) -> str:
    """The command that made a run."""
    return shlex.join(["hlp", "run", *_overrides(folder)])


def _read_sweep(folder: Path) -> ResultSet:
    sweep = read_as(folder / SWEEP, _Sweep)
    folders = [path for path in folder.iterdir() if path.is_dir() and path.name.isdigit()]
    runs = sorted(folders, key=lambda path: int(path.name))
    results = [_read_run(run) for run in runs if _is_finished(run)]
    command = " ".join(["hlp -m", *sweep.overrides])
    chosen = {run: chosen_values(run) for run in runs}
    unfinished = [run for run in runs if not (run / MANIFEST).is_file()]
    return ResultSet(results, sweep.swept, command, chosen, unfinished, sweep.defaults)


def _read_run(folder: Path) -> Result:
    manifest = read_as(folder / MANIFEST, Manifest)
    summary = read_summary(folder / SUMMARY)
    frames, identity = len(manifest.data.keys), manifest.data.frames
    return Result(manifest.config, summary, frames, chosen_values(folder), folder, identity)


def chosen_values(folder: Path) -> dict[str, str]:
    """The overrides of a run as text by key. Raises DataError for a broken file of them."""
    pairs = (pair.lstrip("+").split("=", 1) for pair in _overrides(folder) if "=" in pair)
    return {key: value for key, value in pairs}


def _is_finished(folder: Path) -> bool:
    return all((folder / name).is_file() for name in (MANIFEST, SUMMARY))


def _overrides(folder: Path) -> list[str]:
    path = folder / ".hydra" / "overrides.yaml"
    try:
        given = yaml.safe_load(path.read_text(encoding="utf-8")) if path.is_file() else []
    except (yaml.YAMLError, RecursionError) as error:
        raise DataError(f"{path} is no YAML: {str(error).splitlines()[0]}") from error
    if not isinstance(given, list) or not all(isinstance(word, str) for word in given):
        raise DataError(f"{path} is {shown(given)}: it must be a list of overrides")
    return [word for word in given if not word.startswith("output=")]
