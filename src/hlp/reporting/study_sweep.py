"""What a sweep of studies (oracle, basin, bench, search) ends with: tables and a figure."""

from collections.abc import Sequence
from pathlib import Path

from hlp.files import write_csv, write_text
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.sweep_panels import draw_study_arms
from hlp.reporting.study_arms import StudyArm, StudySweep, say_difference
from hlp.reporting.study_numbers import STUDIES, StudyNumber
from hlp.reporting.sweep_arms import short_key
from hlp.reporting.tables.table import Table, format_interval, lay_out, prose

_PAIRED = (
    "Differences are over the targets of both arms (of times: between their medians), with the 95 %"
    " interval of the paired bootstrap over blocks of neighbouring frames."
)


def study_table(sweep: StudySweep, *, whole: bool = True) -> Table:
    """A row an arm: its values and its numbers; the best arm has a `*`.

    `whole`: with 95 % intervals.
    """
    rows = []
    for arm in sweep.arms:
        found = {each.name: _cell(each, whole) for each in arm.numbers or ()}
        cells = [found.get(name, "") for name in sweep.numbers]
        rows.append([_label(sweep, arm), *(cells if found else ["no result", *cells[1:]])])
    return Table([_keys(sweep), *sweep.numbers], rows)


def differences_table(sweep: StudySweep) -> Table | None:
    """A row a finished arm: the main numbers' paired differences to the reference.

    With 95 % intervals. None where nothing can be compared.
    """
    names = [name for name in sweep.differences if sweep.numbers[name].main]
    if not names:
        return None
    against = "default" if sweep.is_default else "first"
    rows = []
    for arm, _ in sweep.finished:
        found = {name: sweep.differences[name].get(arm.folder.name) for name in names}
        cells = [
            "–" if each is None else say_difference(sweep.numbers[name], each)
            for name, each in found.items()
        ]
        is_reference = arm is sweep.reference
        rows.append([_label(sweep, arm), *([against] * len(names) if is_reference else cells)])
    return Table([_keys(sweep), *(f"{name} to {against}" for name in names)], rows)


def describe_study_sweep(sweep: StudySweep, layout: str) -> str:
    """The arms for people (`text`, which fits a terminal, or `markdown`) with what columns mean.

    A terminal shows the end first, a page the beginning: the verdict stands there.
    """
    differences = differences_table(sweep)
    tables = [study_table(sweep, whole=layout != "text"), *([differences] if differences else [])]
    laid_out = [lay_out(table, layout) for table in tables]
    note, verdict = (prose(words, layout) for words in (note_of(sweep), sweep.verdict))
    parts = (*laid_out, note, verdict) if layout == "text" else (verdict, *laid_out, note)
    return "\n\n".join(parts)


def note_of(sweep: StudySweep) -> str:
    """What the columns and marks of the tables mean."""
    words = [STUDIES[sweep.study].note]
    if sweep.best is not None:
        words.append(f"* the {sweep.rank}.")
    if sweep.differences:
        words.append(_PAIRED)
    return " ".join(words)


def write_study_sweep(folder: Path, sweep: StudySweep) -> list[Path]:
    """Write STUDY.md, STUDY.csv, STUDY.png and STUDY.svg of a sweep of studies; those files.

    The CSV also has the differences of the other numbers.
    """
    markdown, rows = folder / f"{sweep.study}.md", folder / f"{sweep.study}.csv"
    described = describe_study_sweep(sweep, "markdown")
    write_text(markdown, f"{described}\n\nMade by `{sweep.command}`.\n")
    values = [_values(sweep, arm) for arm in sweep.arms]
    known = {name for each in values for name in each}
    columns = [each for name in sweep.numbers for each in _columns(name) if each in known]
    named = [[arm.values.get(key, "") for key in sweep.keys] for arm in sweep.arms]
    write_csv(
        rows,
        [*sweep.keys, *columns],
        [
            [*own, *(each.get(column, "") for column in columns)]
            for own, each in zip(named, values, strict=True)
        ],
    )
    arms = {_label(sweep, arm): numbers for arm, numbers in sweep.finished}
    figure = draw_study_arms(arms, sweep.verdict)
    return [markdown, rows, *save_figure(figure, folder / sweep.study)]


def _keys(sweep: StudySweep) -> str:
    return ", ".join(map(short_key, sweep.keys)) or "run"


def _label(sweep: StudySweep, arm: StudyArm) -> str:
    return f"{arm.label} *" if arm is sweep.best else arm.label


def _cell(number: StudyNumber, whole: bool) -> str:
    if number.interval is None or not whole:
        return number.text
    return f"{number.text} ({format_interval(number.interval)})"


def _values(sweep: StudySweep, arm: StudyArm) -> dict[str, float]:
    """An arm's cells of the CSV by their columns."""
    found: dict[str, float] = {}
    for each in arm.numbers or ():
        difference = sweep.differences.get(each.name, {}).get(arm.folder.name)
        ends = each.interval or ()
        paired = () if difference is None else (difference[0], *difference[1])
        value, low, high, *changed = _columns(each.name)
        found[value] = each.value
        found |= dict(zip((low, high), ends, strict=False))
        found |= dict(zip(changed, paired, strict=False))
    return found


def _columns(name: str) -> Sequence[str]:
    """The columns of a number: with its interval, and with its difference and that interval."""
    ends = ("95 % low", "95 % high")
    changed = f"{name} difference"
    return (
        name, *(f"{name} {end}" for end in ends), changed, *(f"{changed} {end}" for end in ends)
    )  # fmt: skip
