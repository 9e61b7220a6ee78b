"""Finished runs, read back from their folders for figures and tables."""

import logging
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from hlp.errors import DataError
from hlp.files import MANIFEST, SCORES, SUMMARY, SWEEP, TIMES, parse_yaml, read_json
from hlp.folders import found_below
from hlp.reporting.comparison import WELL_VISIBLE, ScoredTarget, read_targets
from hlp.results.recalls import TargetKey, read_summary
from hlp.settings import Stored, read_as, stored_as


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
class Result:
    """One finished run: its whole configuration, its `summary.json`, and the number of frames.

    `chosen` holds the overrides given on the command line or by the sweep, as text by key. `folder`
    is where the run's files are.
    """

    config: Mapping[str, Any]
    summary: Mapping[str, Any]
    frames: int
    chosen: Mapping[str, str]
    folder: Path = Path()

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
        return dict(self.summary["metrics"]["add"])

    @property
    def total_ms(self) -> Mapping[str, float]:
        """`median` and `p95` of the time of one object in one frame (ms)."""
        return dict(self.summary["timing_ms"]["total"])


def result_folders(root: Path) -> list[Path]:
    """Folders in or below `root` that hold a sweep, or a run that belongs to no sweep."""
    sweeps = {path.parent for path in found_below(root, SWEEP)}
    runs = {path.parent for path in found_below(root, MANIFEST) if is_finished(path.parent)}
    return sorted(sweeps | {run for run in runs if run.parent not in sweeps})


@contextmanager
def left_out_if_broken(alone: bool = False) -> Iterator[None]:
    """Around one of several folders: what cannot be read costs itself; if it is `alone`, it raises.

    Summaries of another version are broken, too.
    """
    try:
        yield
    except DataError as error:
        if alone:
            raise
        logging.getLogger(__name__).warning("left out: %s", error)


def run_command(folder: Path) -> str:
    """The command that made a run."""
    return shlex.join(["hlp", "run", *_overrides(folder)])


def read_result(folder: Path) -> Result:
    """The result in the folder of a finished run. Raises DataError for a broken file.

    If its true poses are private, the summary has but `timing`.
    """
    manifest, times = read_as(folder / MANIFEST, Manifest), folder / TIMES
    private = times.is_file() and not (folder / SUMMARY).is_file()
    summary = {"timing": read_json(times)} if private else read_summary(folder / SUMMARY)
    return Result(manifest.config, summary, len(manifest.data.keys), chosen_values(folder), folder)


def chosen_values(folder: Path) -> dict[str, str]:
    """The overrides of a run as text by key. Raises DataError for a broken file of them."""
    pairs = (pair.lstrip("+").split("=", 1) for pair in _overrides(folder) if "=" in pair)
    return {key: value for key, value in pairs}


def is_finished(folder: Path) -> bool:
    """Whether a folder holds a finished run; studies have no summary and are none."""
    return all((folder / name).is_file() for name in (MANIFEST, SUMMARY))


def _overrides(folder: Path) -> list[str]:
    path = folder / ".hydra" / "overrides.yaml"
    try:
        given = parse_yaml(path.read_text(encoding="utf-8"), str(path)) if path.is_file() else []
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is not in UTF-8 ({error.reason})") from error
    overrides = stored_as(list[str], given, str(path))
    return [word for word in overrides if not word.startswith("output=")]
