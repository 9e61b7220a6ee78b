"""What the arms of a sweep of studies (oracle, basin, bench, search) give, and how they differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hlp.files import MANIFEST, SWEEP
from hlp.reporting.comparison import Difference, mean_difference, median_difference
from hlp.reporting.results import chosen_values
from hlp.reporting.study_numbers import STUDIES, StudyKind, StudyNumber, read_study
from hlp.reporting.sweep_arms import holds_defaults, short_key, without_result
from hlp.results.summary_file import TargetKey, read_target_values
from hlp.schemas.outputs import Manifest, Sweep
from hlp.schemas.reading import read_as


@dataclass(frozen=True)
class StudyArm:
    """One arm: its values of the swept keys, and its numbers; None if it has not finished.

    `frames_identity` is the hash of all frames of the data set.
    """

    values: Mapping[str, str]
    folder: Path
    numbers: Sequence[StudyNumber] | None
    frames_identity: str = ""

    @property
    def label(self) -> str:
        """The values in words, e.g. `15, 0`; without swept keys the folder's name."""
        return ", ".join(self.values.values()) or self.folder.name

    @cached_property
    def targets(self) -> Mapping[str, Mapping[TargetKey, float]]:
        """The numbers target by target, as far as they are on disk."""
        return read_target_values(self.folder)


@dataclass(frozen=True)
class StudySweep:
    """The arms of a sweep that are studies of one kind, in the order of their folders.

    `reference` is the finished arm that the others are compared with: the default one, else the
    first.
    """

    study: str
    arms: Sequence[StudyArm]
    keys: Sequence[str]
    command: str
    reference: StudyArm
    is_default: bool

    @property
    def finished(self) -> list[tuple[StudyArm, Sequence[StudyNumber]]]:
        """The arms that have numbers."""
        return [(arm, arm.numbers) for arm in self.arms if arm.numbers is not None]

    @cached_property
    def numbers(self) -> Mapping[str, StudyNumber]:
        """All numbers by name, in their order, with the values of the last arm that has them."""
        return {each.name: each for _, numbers in self.finished for each in numbers}

    @property
    def against(self) -> str:
        """What the arms are compared with."""
        return "the default" if self.is_default else "the first arm"

    @cached_property
    def best(self) -> StudyArm | None:
        """The arm with the highest recall, or the shortest time, by the first main number.

        None if fewer than two finished, or if not all were measured on the same targets.
        """
        name = self._first_main
        found = [arm for arm, _ in self.finished if name in self._values(arm)]
        measured = {(arm.frames_identity, frozenset(arm.targets.get(name, ()))) for arm in found}
        if len(found) < 2 or len(measured) > 1:
            return None
        sign = -1.0 if self.numbers[name].quantity == "time" else 1.0
        return max(found, key=lambda arm: sign * self._values(arm)[name].value)

    @cached_property
    def differences(self) -> Mapping[str, Mapping[str, Difference]]:
        """By number, then by the folder's name of the arm: its number minus the reference's.

        Over the targets of both; of recalls the difference of the means, of times of the medians.
        Numbers and arms that cannot be compared are left out.
        """
        found: dict[str, dict[str, Difference]] = {}
        for name, number in self.numbers.items():
            difference = median_difference if number.quantity == "time" else mean_difference
            for arm, _ in self.finished:
                same = arm.frames_identity == self.reference.frames_identity
                if arm is self.reference or not same:
                    continue
                of = difference(self.reference.targets.get(name, {}), arm.targets.get(name, {}))
                if of is not None:
                    found.setdefault(name, {})[arm.folder.name] = of
        return found

    @property
    def verdict(self) -> str:
        """What was swept, how many arms finished, which is best, and where to look for failures."""
        swept = f" by {', '.join(map(short_key, self.keys))}" if self.keys else ""
        words = [f"{self.study}{swept}: {len(self.finished)} of {len(self.arms)} arms finished"]
        if self.best is not None:
            words += self._describe_best(self.best)
        failed = [(arm.label, arm.folder) for arm in self.arms if arm.numbers is None]
        return "; ".join([*words, *without_result(failed)]) + "."

    @property
    def rank(self) -> str:
        """What the best arm has, in words, e.g. `lowest ms first`."""
        name = self._first_main
        return f"{'lowest' if self.numbers[name].quantity == 'time' else 'highest'} {name}"

    def _describe_best(self, best: StudyArm) -> list[str]:
        name = self._first_main
        number = self._values(best)[name]
        words = [f"{self.rank}: {best.label} ({number.text})"]
        found = self.differences.get(name, {}).get(best.folder.name)
        if best is self.reference:
            words.append(f"that is {self.against}")
        elif found is not None:
            low, high = found[1]
            sure = "surely" if low > 0 or high < 0 else "not surely"
            word = "less" if number.quantity == "time" else "more"
            said = say_difference(number, found)
            words.append(f"{said} against {self.against}, {sure} {word}")
        return words

    @property
    def _first_main(self) -> str:
        return next((name for name, each in self.numbers.items() if each.main), "")

    def _values(self, arm: StudyArm) -> dict[str, StudyNumber]:
        return {each.name: each for each in arm.numbers or ()}


def say_difference(number: StudyNumber, found: Difference) -> str:
    """A difference with its 95 % interval: recalls with three decimals, times with one."""
    form = "{:+.1f}" if number.quantity == "time" else "{:+.3f}"
    difference, low, high = map(form.format, (found[0], *found[1]))
    return f"{difference} ({low} to {high})"


def read_study_sweeps(folder: Path) -> list[StudySweep]:
    """What a sweep holds of each kind of study; empty for a sweep without studies.

    An arm that has not finished is listed with every kind that others are. Raises DataError for a
    broken file.
    """
    record = read_as(folder / SWEEP, Sweep)
    folders = [path for path in folder.iterdir() if path.is_dir() and path.name.isdigit()]
    ordered = sorted(folders, key=lambda path: int(path.name))
    command = " ".join(["hlp -m", *record.overrides])
    sweeps = []
    for study, kind in STUDIES.items():
        arms = [arm for each in ordered if (arm := _read_arm(each, kind, record)) is not None]
        finished = [arm for arm in arms if arm.numbers is not None]
        default = [arm for arm in finished if holds_defaults(arm.values, record.defaults)]
        if finished:
            reference = [*default, *finished][0]
            sweeps.append(StudySweep(study, arms, record.swept, command, reference, bool(default)))
    return sweeps


def _read_arm(folder: Path, kind: StudyKind, sweep: Sweep) -> StudyArm | None:
    """The arm in a folder; None for one that has finished and is no study of this kind."""
    is_finished = (folder / MANIFEST).is_file()
    numbers = read_study(folder, kind) if is_finished else None
    if is_finished and numbers is None:
        return None
    chosen = chosen_values(folder)
    values = {key: chosen[key] for key in sweep.swept if key in chosen}
    identity = read_as(folder / MANIFEST, Manifest).data.frames if is_finished else ""
    return StudyArm(values, folder, numbers, identity)
