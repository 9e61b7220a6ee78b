"""What a sweep of studies (oracle, basin, bench, search) ends with: a table and a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlp.files import MANIFEST, SWEEP, write_csv, write_text
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.study_panels import draw_study_arms
from hlp.reporting.results import chosen_values
from hlp.reporting.study_numbers import STUDIES, StudyNumber, read_study
from hlp.reporting.sweep_arms import log_of, short_key
from hlp.reporting.tables.table import Table, format_interval, lay_out, prose
from hlp.schemas.reading import read_as
from hlp.schemas.runs import Sweep


@dataclass(frozen=True)
class StudyArm:
    """One arm: its values of the swept keys, and its numbers; None if it has not finished."""

    values: Mapping[str, str]
    folder: Path
    numbers: Sequence[StudyNumber] | None

    @property
    def label(self) -> str:
        """The values in words, e.g. `15, 0`; without swept keys the folder's name."""
        return ", ".join(self.values.values()) or self.folder.name


@dataclass(frozen=True)
class StudySweep:
    """The arms of a sweep that are studies of one kind, in the order of their folders."""

    study: str
    arms: Sequence[StudyArm]
    keys: Sequence[str]
    command: str

    @property
    def names(self) -> list[str]:
        """The names of all numbers, in order."""
        return list(dict.fromkeys(each.name for arm in self.arms for each in arm.numbers or ()))

    @property
    def finished(self) -> list[tuple[StudyArm, Sequence[StudyNumber]]]:
        """The arms that have numbers."""
        return [(arm, arm.numbers) for arm in self.arms if arm.numbers is not None]

    @property
    def verdict(self) -> str:
        """What was swept, how many arms finished, and where to look for why one has not."""
        swept = f" by {', '.join(map(short_key, self.keys))}" if self.keys else ""
        words = [f"{self.study}{swept}: {len(self.finished)} of {len(self.arms)} arms finished"]
        if failed := [arm for arm in self.arms if arm.numbers is None]:
            logs = ", ".join(log_of(arm.folder) for arm in failed)
            words.append(f"without a result: {'; '.join(a.label for a in failed)} (see {logs})")
        return "; ".join(words) + "."


def read_study_sweeps(folder: Path) -> list[StudySweep]:
    """What a sweep holds of each kind of study; empty for a sweep without studies.

    An arm that has not finished is listed with every kind that others are. Raises DataError for a
    broken file.
    """
    record = read_as(folder / SWEEP, Sweep)
    folders = [path for path in folder.iterdir() if path.is_dir() and path.name.isdigit()]
    command = " ".join(["hlp -m", *record.overrides])
    sweeps = []
    for study, kind in STUDIES.items():
        arms = []
        for each in sorted(folders, key=lambda path: int(path.name)):
            is_finished = (each / MANIFEST).is_file()
            numbers = read_study(each, kind) if is_finished else None
            if numbers is not None or not is_finished:
                chosen = chosen_values(each)
                values = {key: chosen[key] for key in record.swept if key in chosen}
                arms.append(StudyArm(values, each, numbers))
        if any(arm.numbers is not None for arm in arms):
            sweeps.append(StudySweep(study, arms, record.swept, command))
    return sweeps


def study_table(sweep: StudySweep, *, whole: bool = True) -> Table:
    """A row an arm: its values and its numbers; `whole`: with their 95 % intervals."""
    rows = []
    for arm in sweep.arms:
        found = {each.name: _cell(each, whole) for each in arm.numbers or ()}
        cells = [found.get(name, "") for name in sweep.names]
        rows.append([arm.label, *(cells if found else ["no result", *cells[1:]])])
    return Table([", ".join(map(short_key, sweep.keys)) or "run", *sweep.names], rows)


def _cell(number: StudyNumber, whole: bool) -> str:
    if number.interval is None or not whole:
        return number.text
    return f"{number.text} ({format_interval(number.interval)})"


def describe_study_sweep(sweep: StudySweep, layout: str) -> str:
    """The arms for people (`text`, which fits a terminal, or `markdown`) with what columns mean.

    A terminal shows the end first, a page the beginning: the verdict stands there.
    """
    table = lay_out(study_table(sweep, whole=layout != "text"), layout)
    note, verdict = (prose(words, layout) for words in (STUDIES[sweep.study].note, sweep.verdict))
    parts = (table, note, verdict) if layout == "text" else (verdict, table, note)
    return "\n\n".join(parts)


def write_study_sweep(folder: Path, sweep: StudySweep) -> list[Path]:
    """Write STUDY.md, STUDY.csv, STUDY.png and STUDY.svg of a sweep of studies; those files."""
    markdown, rows = folder / f"{sweep.study}.md", folder / f"{sweep.study}.csv"
    described = describe_study_sweep(sweep, "markdown")
    write_text(markdown, f"{described}\n\nMade by `{sweep.command}`.\n")
    with_interval = {
        each.name for _, numbers in sweep.finished for each in numbers if each.interval is not None
    }
    columns = [
        column
        for name in sweep.names
        for column in (name, *(_ends_of(name) if name in with_interval else ()))
    ]
    write_csv(rows, [*sweep.keys, *columns], [_row(sweep, arm, columns) for arm in sweep.arms])
    arms = {arm.label: numbers for arm, numbers in sweep.finished}
    figure = draw_study_arms(arms, sweep.verdict)
    return [markdown, rows, *save_figure(figure, folder / sweep.study)]


def _row(sweep: StudySweep, arm: StudyArm, columns: Sequence[str]) -> list[str | float]:
    known: dict[str, float] = {}
    for each in arm.numbers or ():
        known[each.name] = each.value
        known |= dict(zip(_ends_of(each.name), each.interval or (), strict=False))
    named = [arm.values.get(key, "") for key in sweep.keys]
    return [*named, *(known.get(column, "") for column in columns)]


def _ends_of(name: str) -> tuple[str, str]:
    return f"{name} 95 % low", f"{name} 95 % high"
