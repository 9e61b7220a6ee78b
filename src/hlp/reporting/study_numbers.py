"""The main numbers of a finished study (oracle, basin, bench, search), read from its folder."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from hlp.errors import DataError
from hlp.files import read_json
from hlp.reporting.figures.basin_maps import read_mean_recalls
from hlp.reporting.tables.bench_table import CONFIGURED, TOTAL, format_ms, read_bench
from hlp.reporting.tables.repeats import head_of
from hlp.reporting.tables.table import format_share

Interval = tuple[float, float]
Quantity = Literal["recall", "time", "other"]


@dataclass(frozen=True)
class StudyNumber:
    """A number of a study: its column in tables, and the panel of the figure that it stands in.

    Without a panel it is in no figure. `text` is how people read it; `interval` is its 95 %
    interval, None where it has none. Arms are compared by the `main` numbers, and the arm that is
    best by the first of them is called the best.
    """

    name: str
    panel: str
    value: float
    text: str
    quantity: Quantity = "other"
    interval: Interval | None = None
    main: bool = False


@dataclass(frozen=True)
class StudyKind:
    """How the numbers of one kind of study are read from a file, and what is to be said of them."""

    file: str
    read: Callable[[Path], list[StudyNumber]]
    note: str


def read_study(folder: Path, kind: StudyKind) -> list[StudyNumber] | None:
    """The numbers of a study; None if the folder holds none of this kind.

    Raises DataError for a broken file.
    """
    path = folder / kind.file
    if not path.is_file():
        return None
    try:
        return kind.read(path)
    except DataError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError, IndexError) as error:
        raise DataError(f"{path} holds no study that can be read ({error!r})") from error


def _read_bench(path: Path) -> list[StudyNumber]:
    result = read_bench(path)
    configured = result["paths"][CONFIGURED]
    numbers = []
    for name, panel, kind in (("ms", "ms", "median_ms"), ("CPU", "CPU ms", "cpu_ms")):
        for unit in ("first", "further"):
            total = configured[unit].get(TOTAL)
            if total is not None:  # frames of a single object have no further one
                is_main = name == "ms"
                numbers.append(_time(f"{name} {unit}", panel, total[kind], main=is_main))
    peak, recall = result["memory"]["peak_mib"], configured["add_recall"]
    numbers.append(StudyNumber("MiB", "peak memory, MiB", peak, f"{peak:.0f}"))
    if recall is not None:
        numbers.append(_recall("ADD(-S)", "ADD(-S) recall", recall, main=True))
    load = result["machine"]["load"]
    return [*numbers, StudyNumber("load", "", load, f"{load:.1f}")]


def _read_oracle(path: Path) -> list[StudyNumber]:
    result = read_json(path)
    numbers = []
    for place, cell in enumerate(result["cells"]):
        low, high = map(float, cell["add"]["ci95"])
        name, recall = head_of(cell), cell["add"]["recall"]
        numbers.append(_recall(name, "ADD(-S) recall", recall, (low, high), main=place == 0))
    for stage, lost in result["lost"].items():
        name, text = f"lost {stage}", f"{lost:+.3f}"
        numbers.append(StudyNumber(name, "recall lost", lost, text, main=True))
    return numbers


def _read_basin(path: Path) -> list[StudyNumber]:
    panel = "ADD(-S) recall, mean over all starting errors"
    return [
        _recall(name, panel, recall, main=True) for name, recall in read_mean_recalls(path).items()
    ]


def _read_search(path: Path) -> list[StudyNumber]:
    result = read_json(path)
    tried = len(result["trials"])
    numbers = [StudyNumber("trials", "trials", tried, str(tried))]
    best: Mapping[str, Any] | None = result["best"]
    if best is not None:
        panel = "ADD(-S) recall of the best trial"
        numbers.append(_recall("best ADD(-S)", panel, best["recall"], main=True))
        numbers.append(_time("its ms", "ms of the best trial", best["time_ms"]))
    return numbers


def _recall(
    name: str, panel: str, value: float, interval: Interval | None = None, *, main: bool
) -> StudyNumber:
    return StudyNumber(name, panel, value, format_share(value), "recall", interval, main)


def _time(name: str, panel: str, value: float, *, main: bool = False) -> StudyNumber:
    return StudyNumber(name, panel, value, format_ms(value), "time", None, main)


STUDIES: Mapping[str, StudyKind] = {
    "bench": StudyKind(
        "bench.json",
        _read_bench,
        "ms: median time to find the first object of a frame, and each further one; CPU: ms of all"
        " threads. MiB: peak memory of the process, which arms of one process share with those"
        " before them; load: of the machine in the minute before the measurement.",
    ),
    "oracle": StudyKind(
        "oracle.json",
        _read_oracle,
        "ADD(-S) recall of all targets. Columns are region and coarse pose: est = estimated, true ="
        " replaced by the truth, true± = the true pose, turned and shifted at random. The fine pose"
        " is always estimated. Lost: what each stage costs in recall.",
    ),
    "basin": StudyKind(
        "basin.csv",
        _read_basin,
        "ADD(-S) recall after each refiner: the mean over all starting errors and objects.",
    ),
    "search": StudyKind(
        "search.json",
        _read_search,
        "The best trial within the limit of time, its ADD(-S) recall, and its median time for one"
        " object in one frame.",
    ),
}
"""The studies by name, which is also that of their task and of their files."""
