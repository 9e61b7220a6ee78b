"""The numbers by which runs and studies (oracle, basin, bench, search) are compared in a sweep."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Optional

from hlp.files import SUMMARY, TIMES
from hlp.reporting.study_tables import TOTAL, format_ms, head_of, read_mean_recalls
from hlp.reporting.summary_tables import METRIC_LABELS, run_cells, run_numbers
from hlp.reporting.table import format_share
from hlp.results.recalls import INTERVAL, read_summary
from hlp.schemas import by_name, record, several
from hlp.settings import NotNegative, Share, read_as

Interval = tuple[float, float]
RUN = "sweep"
"""The kind of a plain run; its files are called so."""
ADD = METRIC_LABELS["add"]


@dataclass(frozen=True)
class Number:
    """A number of a run or study: its column in tables, and the panel of the figure it stands in.

    Without a panel it is in no figure. `text` is how people read it; `interval` is its 95 %
    interval, None where it has none. Runs are compared by the `main` numbers, and the run that is
    best by the first of them is called the best. Only wide tables show `more`.
    """

    name: str
    panel: str
    value: float
    text: str
    is_recall: bool = False
    interval: Interval | None = None
    main: bool = False
    more: bool = False


@dataclass(frozen=True)
class Kind:
    """How the numbers of one kind of study are read from a file, and what is to be said of them."""

    file: str
    read: Callable[[Path], list[Number]]
    note: str


def read_numbers(folder: Path, kind: Kind) -> dict[str, Number]:
    """The numbers of a run or study by name; empty if the folder holds none of this kind.

    Raises DataError for a broken file.
    """
    path = folder / kind.file
    return {number.name: number for number in kind.read(path)} if path.is_file() else {}


def _recall(
    name: str, panel: str, value: float, interval: Interval | None = None, *, main: bool = False
) -> Number:
    return Number(name, panel, value, format_share(value), True, interval, main)


def _read_run(path: Path) -> list[Number]:
    summary = read_summary(path)
    values, cells = run_numbers(summary), run_cells(summary)
    add = summary["metrics"]["add"]
    numbers = [
        Number("targets", "", summary["targets"], cells["targets"], more=True),
        _recall(ADD, "", add["recall"], tuple(add["ci95"]), main=True),
    ]
    for name in ("5cm5deg", "IoU.5", "AR", "ms", "ms 95 %", "CPU ms", "load"):
        value, more = values[name], name not in ("5cm5deg", "ms", "load")
        known = math.nan if value is None else value
        numbers.append(Number(name, "", known, cells[name], more=more))
    return numbers


_TIMES = by_name(record(median_ms=NotNegative))
_MEANS = record(wall_ms=Optional[NotNegative], cpu_ms=Optional[NotNegative])  # noqa: UP045
_PATH = record(first=_TIMES, further=_TIMES, add_recall=Share)
_BENCH = record(
    paths=record(configured=_PATH),
    memory=record(peak_mib=NotNegative),
    machine=record(load=NotNegative),
)


def _read_times(path: Path) -> list[Number]:
    found: Any = read_as(path, _MEANS)
    return [
        Number(name, "ms", time, format_ms(time))
        for name, time in {"ms": found.wall_ms, "CPU ms": found.cpu_ms}.items()
        if time is not None
    ]


def _read_bench(path: Path) -> list[Number]:
    result = read_as(path, _BENCH)
    configured, numbers = result.paths.configured, []
    for unit in ("first", "further"):
        # Frames of a single object have no further one.
        if total := getattr(configured, unit).get(TOTAL):
            numbers.append(Number(f"ms {unit}", "ms", total.median_ms, format_ms(total.median_ms)))
    peak, load = result.memory.peak_mib, result.machine.load
    numbers.append(Number("MiB", "peak memory, MiB", peak, f"{peak:.0f}"))
    numbers.append(_recall(ADD, "ADD(-S) recall", configured.add_recall, main=True))
    return [*numbers, Number("load", "", load, f"{load:.1f}")]


_PLACE = Literal["estimated", "true"]
_CELL = record(region=_PLACE, coarse=_PLACE, add=INTERVAL)
_ORACLE = record(cells=several(_CELL), lost=by_name(float))


def _read_oracle(path: Path) -> list[Number]:
    result = read_as(path, _ORACLE)
    numbers = []
    for place, cell in enumerate(result.cells):
        name, add, main = head_of(cell.region, cell.coarse), cell.add, place == 0
        numbers.append(_recall(name, "ADD(-S) recall", add.recall, add.ci95, main=main))
    return numbers + [
        Number(f"lost {stage}", "recall lost", lost, f"{lost:+.3f}")
        for stage, lost in result.lost.items()
    ]


def _read_basin(path: Path) -> list[Number]:
    panel = "ADD(-S) recall, mean over all starting errors"
    means = read_mean_recalls(path).items()
    return [_recall(name, panel, recall, main=True) for name, recall in means]


_BEST = record(recall=Share, time_ms=NotNegative)
_SEARCH = record(trials=several(Any), best=Optional[_BEST])  # noqa: UP045


def _read_search(path: Path) -> list[Number]:
    result = read_as(path, _SEARCH)
    tried, best = len(result.trials), result.best
    numbers = [Number("trials", "trials", tried, str(tried))]
    if best is not None:
        panel, time = "ADD(-S) recall of the best trial", best.time_ms
        numbers.append(_recall("best ADD(-S)", panel, best.recall, main=True))
        numbers.append(Number("its ms", "ms of the best trial", time, format_ms(time)))
    return numbers


KINDS: Mapping[str, Kind] = {
    RUN: Kind(
        SUMMARY,
        _read_run,
        "AR: BOP's average recall; ms: median for one object in one frame; CPU ms: mean CPU time of"
        " all threads for it; load: of the machine in the minute before.",
    ),
    "times": Kind(
        TIMES,
        _read_times,
        "The true poses are private: nothing is scored. ms: mean for one object in one frame; CPU"
        " ms: of all threads.",
    ),
    "bench": Kind(
        "bench.json",
        _read_bench,
        "ms: median time to find the first object of a frame, and each further one. MiB: peak"
        " memory of the process, which runs of one process share with those before them; load: of"
        " the machine in the minute before the measurement.",
    ),
    "oracle": Kind(
        "oracle.json",
        _read_oracle,
        "ADD(-S) recall of all targets. Columns are region and coarse pose: est = estimated, true ="
        " replaced by the truth. The fine pose is always estimated. Lost: what each stage costs in"
        " recall.",
    ),
    "basin": Kind(
        "basin.csv",
        _read_basin,
        "ADD(-S) recall after each refiner: the mean over all starting errors and objects.",
    ),
    "search": Kind(
        "search.json",
        _read_search,
        "The best trial within the limit of time, its ADD(-S) recall, and its median time for one"
        " object in one frame.",
    ),
}
"""Runs and studies by name; of a study, also that of its task and of its files."""
