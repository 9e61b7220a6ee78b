"""What the arms of a sweep give: a row an arm, with its difference to the default arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hlp.files import SCORES
from hlp.reporting.comparison import Difference, ScoredTarget, paired_difference, read_targets
from hlp.reporting.results import Result, ResultSet
from hlp.reporting.tables.summary_tables import average_recall
from hlp.reporting.tables.table import Table, format_interval, format_share
from hlp.results.summary_file import TargetKey

_LONGEST = 24  # characters of a value in a table
_LOG = "hlp.log"
_TIMES = ["ms 95 %", "CPU ms", "load"]


@dataclass(frozen=True)
class SweepArm:
    """One arm: its values of the swept keys, and its result; None if it has not finished."""

    values: Mapping[str, str]
    folder: Path
    result: Result | None

    @cached_property
    def targets(self) -> dict[TargetKey, ScoredTarget]:
        """The scored targets; empty where there are none on disk."""
        path = self.folder / SCORES
        return read_targets(path) if self.result and path.is_file() else {}

    @property
    def label(self) -> str:
        """The values in words, e.g. `dimension 200, seed 1`."""
        pairs = (f"{short_key(key)} {value}" for key, value in self.values.items())
        return ", ".join(pairs) or self.folder.name


@dataclass(frozen=True)
class Sweep:
    """All arms in their order; `reference` is the one that the others are compared with."""

    arms: Sequence[SweepArm]
    keys: Sequence[str]
    reference: SweepArm | None
    is_default: bool
    command: str

    @property
    def finished(self) -> list[tuple[SweepArm, Result]]:
        """The arms that have a result."""
        return [(arm, arm.result) for arm in self.arms if arm.result is not None]

    @property
    def best(self) -> SweepArm | None:
        """The arm with the highest ADD(-S) recall; the default unless that one is surely better."""
        highest = self.highest
        found = None if highest is None or not self.is_default else self.difference(highest)
        return highest if found is None or found[1][0] > 0 else self.reference

    @property
    def highest(self) -> SweepArm | None:
        """The arm with the highest ADD(-S) recall, the fastest of several.

        None if fewer than two finished, or if not all were measured on the same frames.
        """
        found = self.finished
        if len(found) < 2 or len({result.frames_identity for _, result in found}) > 1:
            return None
        return max(found, key=lambda each: (each[1].add["recall"], -each[1].total_ms["median"]))[0]

    def difference(self, arm: SweepArm) -> Difference | None:
        """The arm's ADD(-S) recall minus the reference's; None where they share no target."""
        first = self.reference
        if first is None or arm is first or arm.result is None or first.result is None:
            return None
        if arm.result.frames_identity != first.result.frames_identity:
            return None  # targets of equal names, but of other frames
        return paired_difference(first.targets, arm.targets, "add")


def sweep_of(found: ResultSet) -> Sweep:
    """The arms of a sweep's results, finished or not, in the order of their folders."""
    results = {result.folder: result for result in found.results}
    chosen = {**{f: r.chosen for f, r in results.items()}, **found.unfinished}
    folders = sorted(chosen, key=lambda each: (len(each.name), each.name))
    arms = [
        SweepArm(
            {key: chosen[folder][key] for key in found.swept if key in chosen[folder]},
            folder,
            results.get(folder),
        )
        for folder in folders
    ]
    finished = [arm for arm in arms if arm.result is not None]
    default = [arm for arm in finished if holds_defaults(arm.values, found.defaults)]
    reference = next(iter(default or finished), None)
    return Sweep(arms, found.swept, reference, bool(default), found.command)


def holds_defaults(values: Mapping[str, str], defaults: Mapping[str, str]) -> bool:
    """Whether an arm's values of the swept keys are the defaults; not where none are known."""
    pairs = [(values.get(key, each), each) for key, each in defaults.items()]
    return bool(pairs) and all(_value(given) == _value(each) for given, each in pairs)


def _value(text: str) -> float | str:
    """A number as such, since 5 and 5.0 are the same value."""
    try:
        return float(text)
    except ValueError:
        return text


def short_key(key: str) -> str:
    """The last part of a key."""
    return key.rpartition(".")[2].rpartition("/")[2]


def without_result(failed: Sequence[tuple[str, Path]]) -> list[str]:
    """Which arms failed, given in words and by folder, and where their logs lie; or nothing."""
    if not failed:
        return []
    names = "; ".join(name for name, _ in failed)
    logs = ", ".join(str(Path(folder.name, _LOG)) for _, folder in failed)
    return [f"without a result: {names} (see {logs})"]


def sweep_table(sweep: Sweep, *, whole: bool = True) -> Table:
    """A row an arm: values, recalls, time, difference to the reference with its 95 % interval.

    `whole`: also what does not fit a terminal: targets, IoU, BOP's average recall, the 95th
    percentile of time, mean CPU time, and the load of the machine while times were measured.
    """
    extra = (["targets"], ["IoU.5", "AR"], _TIMES) if whole else ([], [], [])
    names = [short_key(key) for key in sweep.keys] or ["run"]
    against = "to default" if sweep.is_default else "to first"
    header = [*names, *extra[0], "ADD(-S)", "95 %", "5cm5deg", *extra[1], "ms", *extra[2]]
    return Table([*header, against, "95 % of it"], [_row(sweep, arm, whole) for arm in sweep.arms])


def _row(sweep: Sweep, arm: SweepArm, whole: bool) -> list[str]:
    named = [_cut(arm.values.get(key, "")) for key in sweep.keys] or [arm.folder.name]
    if arm is sweep.best:
        named[-1] += " *"
    result = arm.result
    if result is None:
        return [*named, *[""] * whole, "no result", *[""] * (5 + (2 + len(_TIMES)) * whole)]
    metrics, times = result.summary["metrics"], result.total_ms
    recalls = [
        format_share(result.add["recall"]),
        format_interval(result.add["ci95"]),
        format_share(metrics["5cm5deg"]["recall"]),
    ]
    if whole:
        recalls += [format_share(metrics["iou50"]["recall"]), average_recall(result.summary)]
    spent = [f"{times['median']:.0f}", *(_more_times(result) if whole else [])]
    return [*named, *([str(result.targets)] if whole else []), *recalls, *spent,
            *_against(sweep, arm)]  # fmt: skip


def _more_times(result: Result) -> list[str]:
    timing = result.summary.get("timing", {})
    cpu, load = timing.get("cpu_ms"), timing.get("load")
    return [
        f"{result.total_ms['p95']:.0f}",
        "" if cpu is None else f"{cpu:.0f}",
        "" if load is None else f"{load:.1f}",
    ]


def _against(sweep: Sweep, arm: SweepArm) -> list[str]:
    if arm is sweep.reference:
        return ["default" if sweep.is_default else "first", ""]
    found = sweep.difference(arm)
    if found is None:
        return ["–", ""]
    difference, (low, high) = found
    return [f"{difference:+.3f}", f"{low:+.3f} to {high:+.3f}"]


def _cut(value: str) -> str:
    return value if len(value) <= _LONGEST else f"{value[: _LONGEST - 1]}…"


def sweep_verdict(sweep: Sweep) -> str:
    """The best arm, whether it is surely better than the reference, and what failed."""
    failed = [(arm.label, arm.folder) for arm in sweep.arms if arm.result is None]
    words = [f"{len(sweep.finished)} of {len(sweep.arms)} arms finished"]
    best, highest = sweep.best, sweep.highest
    if best is not None and highest is not None and sweep.reference is not None:
        words.append(f"best by ADD(-S): {_measured(best)}")
        words.append(_sure(sweep, best))
        if highest is not best:
            against = "{} ({})".format(*_against(sweep, highest))
            words.append(f"a tie with it: {_measured(highest)}, {against}")
    return "; ".join([*words, *without_result(failed)]) + "."


def _measured(arm: SweepArm) -> str:
    assert arm.result is not None
    add, time = arm.result.add["recall"], arm.result.total_ms["median"]
    return f"{arm.label} ({add:.3f}, {time:.0f} ms)"


def _sure(sweep: Sweep, best: SweepArm) -> str:
    name = "the default" if sweep.is_default else "the first arm"
    found = sweep.difference(best)
    if best is sweep.reference:
        return f"that is {name}"
    if found is None:
        return f"it shares no target with {name}"
    difference, (low, high) = found
    sure = "more" if low > 0 else "not surely more"
    return f"{difference:+.3f} against {name}, {sure} ({low:+.3f} to {high:+.3f})"
