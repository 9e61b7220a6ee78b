"""What the runs of a sweep give, and how they differ; they may be studies (oracle, basin, …)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from hlp.files import MANIFEST, SWEEP
from hlp.reporting.comparison import Difference, difference_cells, paired_difference, surely
from hlp.reporting.results import (
    Manifest,
    Result,
    chosen_values,
    is_finished,
    read_result,
    run_command,
)
from hlp.reporting.study_numbers import ADD, KINDS, RUN, Number, read_numbers
from hlp.results.recalls import TargetKey, read_target_values
from hlp.settings import Stored, read_as

_LOG = "hlp.log"


@dataclass(frozen=True)
class _Stated(Stored):
    """sweep.json; `defaults` are the values of the swept keys without the sweep, if known."""

    overrides: list[str]
    swept: list[str]
    defaults: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class SweepRun:
    """One run: its values of the swept keys, and its numbers by name; none if it is unfinished.

    `frames_identity` is the hash of all frames of the data set. `result` is that of a plain run.
    """

    values: Mapping[str, str]
    folder: Path
    numbers: Mapping[str, Number]
    frames_identity: str = ""
    result: Result | None = None

    @property
    def label(self) -> str:
        """The values in words, e.g. `dimension 200, seed 1`; without any the folder's name."""
        pairs = (f"{short_key(key)} {value}" for key, value in self.values.items())
        return ", ".join(pairs) or self.folder.name

    @property
    def short_label(self) -> str:
        """As `label`, without the name of the key if there is but one."""
        return ", ".join(self.values.values()) if len(self.values) == 1 else self.label

    @cached_property
    def targets(self) -> Mapping[str, Mapping[TargetKey, float]]:
        """The numbers target by target, as far as they are on disk."""
        if self.result is None:
            return read_target_values(self.folder)
        return {ADD: self.result.verdicts}


@dataclass(frozen=True)
class Sweep:
    """The runs of a sweep that are of one kind, in the order of their folders; or a single run.

    `reference` is the finished run that the others are compared with: that of the defaults, else
    the first; None without any.
    """

    name: str
    runs: Sequence[SweepRun]
    keys: Sequence[str]
    command: str
    reference: SweepRun | None
    is_default: bool

    @property
    def finished(self) -> list[SweepRun]:
        """The runs that have numbers."""
        return [run for run in self.runs if run.numbers]

    @property
    def unfinished(self) -> list[SweepRun]:
        """The others."""
        return [run for run in self.runs if not run.numbers]

    @property
    def results(self) -> list[Result]:
        """The results of the finished runs; none of studies."""
        return [run.result for run in self.runs if run.result is not None]

    @cached_property
    def numbers(self) -> Mapping[str, Number]:
        """All numbers by name, in their order, with the values of the last run that has them."""
        return {name: number for run in self.finished for name, number in run.numbers.items()}

    @property
    def against(self) -> str:
        """What the runs are compared with, in one word."""
        return "default" if self.is_default else "first"

    @property
    def mains(self) -> list[str]:
        """The numbers by which runs are compared."""
        return [name for name, number in self.numbers.items() if number.main]

    @property
    def first_main(self) -> str:
        """The number that decides which run is the best; empty without any."""
        return next(iter(self.mains), "")

    @cached_property
    def best(self) -> SweepRun | None:
        """The run with the highest recall, by the first main number.

        That of the defaults, unless the other is surely better. None if fewer than two finished, or
        if their targets differ.
        """
        name, default = self.first_main, self.reference
        found = [run for run in self.finished if name in run.numbers]
        same = {(run.frames_identity, frozenset(run.targets.get(name, ()))) for run in found}
        if len(found) < 2 or len(same) > 1:
            return None
        highest = max(found, key=lambda run: run.numbers[name].value)
        tied = self.is_default and default and self._are_tied(default, highest)
        return default if tied else highest

    @cached_property
    def ties(self) -> list[SweepRun]:
        """The runs that the best one is not surely better than, the highest first."""
        best, name = self.best, self.first_main
        others = [run for run in self.finished if best and run is not best and name in run.numbers]
        tied = [run for run in others if best and self._are_tied(best, run)]
        return sorted(tied, key=lambda run: -run.numbers[name].value)

    def _are_tied(self, first: SweepRun, second: SweepRun) -> bool:
        found = self._paired(first, second, self.first_main)
        return found is not None and not surely(found)

    def _paired(self, first: SweepRun, second: SweepRun, name: str) -> Difference | None:
        """Second's number minus first's."""
        if first.frames_identity != second.frames_identity:
            return None  # targets of equal names may be of other frames
        return paired_difference(*(run.targets.get(name, {}) for run in (first, second)))

    def difference(self, run: SweepRun, name: str) -> Difference | None:
        """The run's number minus the reference's, over the targets of both.

        None for the reference itself, and for what cannot be compared.
        """
        return self.differences.get(name, {}).get(run.folder.name)

    @cached_property
    def differences(self) -> Mapping[str, Mapping[str, Difference]]:
        """By number, then by the folder's name of the run: its number minus the reference's."""
        found: dict[str, dict[str, Difference]] = {}
        if (first := self.reference) is None:
            return found
        for name in self.numbers:
            for run in self.finished:
                if run is not first and (of := self._paired(first, run, name)) is not None:
                    found.setdefault(name, {})[run.folder.name] = of
        return found

    @property
    def winner(self) -> str:
        """The best run in words, what it is compared with, and its ties; empty without any."""
        if (best := self.best) is None:
            return ""
        tied = f"; a tie with it: {', '.join(map(self._measured, self.ties))}" if self.ties else ""
        return f"{self._measured(best)}, {self._compared(best)}{tied}"

    @property
    def verdict(self) -> str:
        """What was swept, how many runs finished, which is best, and where to look for failures."""
        swept = f" by {', '.join(map(short_key, self.keys))}" if self.keys else ""
        words = [f"{self.name}{swept}: {len(self.finished)} of {len(self.runs)} runs finished"]
        if self.winner:
            words.append(f"best by {self.first_main}: {self.winner}")
        if failed := self.unfinished:
            logs = ", ".join(str(Path(run.folder.name, _LOG)) for run in failed)
            words.append(f"without a result: {'; '.join(r.label for r in failed)} (see {logs})")
        return "; ".join(words) + "."

    def _measured(self, run: SweepRun) -> str:
        return f"{run.label} ({run.numbers[self.first_main].text})"

    def _compared(self, run: SweepRun) -> str:
        name = "the default" if self.is_default else "the first run"
        if run is self.reference:
            return name
        found = self.difference(run, self.first_main)
        if found is None:
            return f"it shares no target with {name}"
        words, interval = difference_cells(found)
        return f"{words} ({interval}) against {name}, {'' if surely(found) else 'not '}surely more"


def short_key(key: str) -> str:
    """The last part of a key."""
    return key.rpartition(".")[2].rpartition("/")[2]


def read_sweeps(folder: Path) -> list[Sweep]:
    """What a sweep, or a run of its own, holds of each kind: plain runs, and studies.

    Empty before the first run. A run that has not finished is listed with every kind that others
    are; with plain runs if none has finished. Raises DataError for a broken file, naming it.
    """
    stated, command, folders = _Stated([], []), run_command(folder), [folder]
    if (folder / SWEEP).is_file():
        stated = read_as(folder / SWEEP, _Stated)
        numbered = (path for path in folder.iterdir() if path.name.isdecimal() and path.is_dir())
        folders = sorted(numbered, key=lambda path: int(path.name))
        command = " ".join(["hlp -m", *stated.overrides])
    results = {run: read_result(run) for run in folders if run == folder or is_finished(run)}
    chosen = {run: chosen_values(run) for run in folders}
    sweeps = []
    for name, kind in KINDS.items():
        runs = []
        for run, given in chosen.items():
            values = {key: given[key] for key in stated.swept if key in given}
            if not (run / MANIFEST).is_file():
                runs.append(SweepRun(values, run, {}))
            elif numbers := read_numbers(run, kind):
                identity = read_as(run / MANIFEST, Manifest).data.frames
                of_kind = results.get(run) if name == RUN else None
                runs.append(SweepRun(values, run, numbers, identity, of_kind))
        finished = [run for run in runs if run.numbers]
        default = [run for run in finished if _holds(run.values, stated.defaults)]
        reference = next(iter([*default, *finished]), None)
        if finished or (runs and name == RUN and len(runs) == len(folders)):
            sweeps.append(Sweep(name, runs, stated.swept, command, reference, bool(default)))
    return sweeps


def _holds(values: Mapping[str, str], defaults: Mapping[str, str]) -> bool:
    """Whether a run's values of the swept keys are the defaults; not where none are known."""
    pairs = [(values.get(key, value), value) for key, value in defaults.items()]
    return bool(pairs) and all(_plain(given) == _plain(value) for given, value in pairs)


def _plain(value: Any) -> float | str:
    """A number as such, since 5 and 5.0 are the same value; else the value as text."""
    try:
        return float(str(value))
    except ValueError:
        return str(value)
