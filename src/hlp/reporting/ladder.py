"""What each decision gives: the table and the figure of the arms of `experiment=ladder`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hlp.files import SCORES, write_csv, write_text
from hlp.reporting.comparison import ScoredTarget, paired_difference, read_targets
from hlp.reporting.figures.saving import save_figure
from hlp.reporting.figures.swarm_costs import Step, draw_steps
from hlp.reporting.results import Result, ResultSet, read_results, result_folders
from hlp.reporting.tables.summary_tables import average_recall
from hlp.reporting.tables.table import Table, format_interval, format_share, lay_out, prose
from hlp.results.summary_file import TargetKey

NAME = "ladder"
"""The experiment, the swept config group, and the files of table and figure."""
_HEADER = ["arm", "change", "ADD(-S)", "95 %", "5cm5deg", "IoU", "AR", "ms"]
_WIDE = ("change", "95 %", "5cm5deg", "IoU", "AR")  # columns for which a terminal has no room
_AGAINST = ["against", "ADD(-S) gained", "95 % of it", "ms more"]


@dataclass(frozen=True)
class Gain:
    """What an arm gives against another: ADD(-S) recall, its 95 % interval, time of an object."""

    recall: float
    interval: tuple[float, float]
    milliseconds: float


@dataclass(frozen=True)
class Arm:
    """One finished arm: its name, what it changes, and the arm that it is compared with."""

    name: str
    change: str
    before: str | None
    result: Result

    @cached_property
    def targets(self) -> dict[TargetKey, ScoredTarget]:
        """The scored targets."""
        return read_targets(self.result.folder / SCORES)


def describe_ladders(root: Path, layout: str) -> str:
    """The tables of all ladders in or below a folder, which are written anew with their figures.

    Empty if there is none. `layout` is `text` or `markdown`.
    """
    parts = []
    for folder in result_folders(root):
        files = write_ladder(folder)
        if files:
            found = read_results(folder)
            written = ", ".join(str(path) for path in files)
            table = ladder_table(arms_of(found))
            if layout == "text":
                narrow = table.without(*_WIDE)
                header = [name.removeprefix("ADD(-S) ") for name in narrow.header]
                table = Table(header, narrow.rows).fitted(0, header.index("against"))
            said = [prose(words, layout) for words in (_note(found), f"Written: {written}")]
            parts += [said[0], lay_out(table, layout), said[1]]
    return "\n\n".join(parts)


def write_ladder(folder: Path) -> list[Path]:
    """Write ladder.png, .svg, .md and .csv of a sweep over arms; those files, none otherwise."""
    found = read_results(folder)
    arms = arms_of(found)
    if not arms:
        return []
    table = ladder_table(arms)
    png, svg = save_figure(draw_steps(_steps(arms), _measured(arms[0].result)), folder / NAME)
    markdown, rows = folder / f"{NAME}.md", folder / f"{NAME}.csv"
    picture = f"![{NAME}]({svg.name})"
    write_text(markdown, "\n\n".join([picture, _note(found), table.markdown()]) + "\n")
    write_csv(rows, table.header, table.rows)
    return [png, svg, markdown, rows]


def arms_of(found: ResultSet) -> list[Arm]:
    """The arms among some results, in the order of the sweep; none of another experiment."""
    arms = []
    for result in found.results:
        given = result.config.get("arm", {})
        if result.experiment == NAME and NAME in result.chosen:
            arms.append(Arm(result.chosen[NAME], given["change"], given["before"], result))
    return arms


def ladder_table(arms: Sequence[Arm]) -> Table:
    """A row an arm: recalls and time, and what it gains against the arm that it names."""
    known = {arm.name: arm for arm in arms}
    return Table([*_HEADER, *_AGAINST], [_row(arm, known) for arm in arms])


def gain_of(arm: Arm, known: Mapping[str, Arm]) -> Gain | None:
    """The gain over the arm named by `before`, on the targets of both; None if it is absent."""
    other = known.get(arm.before or "")
    if other is None:
        return None
    gained = paired_difference(other.targets, arm.targets, "add")
    if gained is None:
        return None
    spent = arm.result.total_ms["median"] - other.result.total_ms["median"]
    return Gain(*gained, spent)


def _row(arm: Arm, known: Mapping[str, Arm]) -> list[str]:
    result, gain = arm.result, gain_of(arm, known)
    metrics = result.summary["metrics"]
    against = ["–"] * len(_AGAINST)
    if gain is not None:
        low, high = gain.interval
        against = [
            str(arm.before),
            f"{gain.recall:+.3f}",
            f"{low:+.3f} to {high:+.3f}",
            f"{gain.milliseconds:+.0f}",
        ]
    return [
        arm.name,
        arm.change,
        format_share(result.add["recall"]),
        format_interval(result.add["ci95"]),
        format_share(metrics["5cm5deg"]["recall"]),
        format_share(metrics["iou50"]["recall"]),
        average_recall(result.summary),
        f"{result.total_ms['median']:.0f}",
        *against,
    ]


def _steps(arms: Sequence[Arm]) -> list[Step]:
    known = {arm.name: arm for arm in arms}
    steps = []
    for arm in arms:
        gain, ends = gain_of(arm, known), arm.result.add["ci95"]
        gained = None if gain is None else (gain.recall, gain.interval)
        recall = (float(arm.result.add["recall"]), (float(ends[0]), float(ends[1])))
        steps.append(Step(arm.name, recall, gained))
    return steps


def _measured(result: Result) -> str:
    return f"{result.targets} targets in {result.frames} frames of {result.config['data']['name']}"


def _note(found: ResultSet) -> str:
    missing = f" Unfinished: {len(found.unfinished)}." if found.unfinished else ""
    return (
        f"Made by `{found.command}`.{missing} Each arm differs by one decision from the arm under"
        " *against*; what it gains is over the targets of both, with the 95 % interval of the"
        " paired bootstrap over blocks of neighbouring frames. AR: BOP's average recall. ms: median"
        " for one object in one frame."
    )
