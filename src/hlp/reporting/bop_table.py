"""`experiment=bop`: BOP's data sets by one configuration, beside published methods.

`hlp_SET-test.csv` are the poses as BOP's server takes them (bop.felk.cvut.cz), `hlp_bop.zip` holds
them all.
"""

import zipfile
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from hlp.files import MANIFEST, POSES, SUMMARY, TIMES, read_csv, write_csv
from hlp.reporting.results import Manifest, Result, read_result
from hlp.reporting.summary_tables import BOP_RECALLS
from hlp.reporting.table import Table, format_share
from hlp.results.poses_file import POSE_COLUMNS
from hlp.settings import read_as

BOP = "bop"
PUBLISHED = (
    ("FreeZeV2.1, 2024", 0.821, 24.9, "GPU"),
    ("Co-op, 2024", 0.759, 0.8, "GPU"),
    ("FoundationPose, 2024", 0.734, 29.3, "GPU"),
    ("SAM-6D, 2024", 0.662, 1.4, "GPU"),
    ("Vidal et al., 2018", 0.569, 3.2, "CPU"),
    ("Drost et al., 2010", 0.550, None, "CPU"),
)
"""Methods with their AR over the seven core sets, seconds an image, and hardware.

Sources: BOP Challenge 2024 (arXiv 2504.02812), BOP Challenge 2019, and the server's leaderboard.
"""
NOTE = (
    "AR: mean of BOP's average recalls VSD, MSSD and MSPD, the objects of an image being given. AP:"
    " BOP's average precision (2024), every object of the set being looked for in every image;"
    " AP mm: over 2 to 20 mm of MSSD (2025). Seconds of an image include those without an answer."
    " Means are over the sets whose true poses are known. The published rows are means over seven"
    " core sets, measured by others on their hardware (arXiv 2504.02812 and BOP's leaderboard)."
)
_NUMBERS = ["images", "AR", *map(str.upper, BOP_RECALLS), "AP", "AP mm", "s", "CPU s"]
_DIGITS = {"images": 0, "s": 1, "CPU s": 1}  # 3 of the others


def bop_table(results: Sequence[Result]) -> Table:
    """A row a set and task, the mean of each task over several sets, and published methods."""
    rows: list[list[str]] = []
    for task in ("localization", "detection"):
        own_task = [result for result in results if _task(result.config) == task]
        found = {_set(result.config): _numbers(result) for result in own_task}
        on = {_set(r.config): str(r.config["machine"]["device"]).upper() for r in own_task}
        rows += [[name, *_cells(numbers), on[name]] for name, numbers in found.items()]
        averaged = [own for own in found.values() if {own["AR"], own["AP"]} != {None}]
        averaged = averaged or [*found.values()]
        if len(averaged) > 1:
            means = {name: _mean([own[name] for own in averaged]) for name in _NUMBERS}
            means["images"] = sum(own["images"] or 0 for own in averaged)
            rows.append([f"mean, {task}", *_cells(means), ", ".join(sorted({*on.values()}))])
    for name, recall, seconds, hardware in PUBLISHED:
        numbers = dict.fromkeys(_NUMBERS) | {"AR": recall, "s": seconds}
        rows.append([name, *_cells(numbers), hardware])
    return Table(["set", *_NUMBERS, "on"], rows)


def bop_runs(folder: Path) -> list[Result]:
    """The finished runs in a sweep's folder, or that of one run; also those of private true poses.

    Raises DataError for a broken file.
    """
    manifests = [*folder.glob(MANIFEST), *sorted(folder.glob(f"*/{MANIFEST}"))]
    runs = [path.parent for path in manifests]
    ended = [run for run in runs if (run / SUMMARY).is_file() or (run / TIMES).is_file()]
    of_bop = [run for run in ended if read_as(run / MANIFEST, Manifest).config["name"] == BOP]
    return [read_result(run) for run in of_bop]


def write_server_files(folder: Path) -> list[Path]:
    """Copy the poses of `bop_runs` under BOP's names, and pack them.

    Those of detection have `-detection` in their names, since the server has another form for them.
    The time of an image that an earlier, interrupted call had searched is not known (-1). With one
    such image the server shows no time at all: it gets the mean of those that were measured.
    """
    written: list[Path] = []
    for run in bop_runs(folder):
        split = "val" if str(run.config["data"]["split"]).startswith("val") else "test"
        task = "-detection" if _task(run.config) == "detection" else ""
        written.append(folder / f"hlp{task}_{_set(run.config)}-{split}.csv")
        seconds = _numbers(run)["s"]
        rows = read_csv(run.folder / POSES, POSE_COLUMNS)
        for row in rows:
            if seconds is not None and float(row["time"] or 0) < 0:
                row["time"] = seconds
        write_csv(written[-1], POSE_COLUMNS, [list(row.values()) for row in rows])
    if written:
        with zipfile.ZipFile(folder / "hlp_bop.zip", "w", zipfile.ZIP_DEFLATED) as packed:
            for path in written:
                packed.write(path, path.name)
        written.append(folder / "hlp_bop.zip")
    return written


def _set(config: Any) -> str:
    return Path(str(config["data"]["root"])).name


def _task(config: Any) -> str:
    return "detection" if config["data"].get("search") == "all" else "localization"


def _numbers(result: Result) -> dict[str, float | None]:
    summary, timing = result.summary, result.summary.get("timing", {})
    recalls = summary.get("bop", {}) if _task(result.config) == "localization" else {}
    precision = summary.get("detection", {})
    objects = timing.get("objects", 0) / max(timing.get("frames", 0), 1)  # in an image
    seconds = [
        None if timing.get(key) is None else objects * timing[key] / 1000
        for key in ("wall_ms", "cpu_ms")
    ]
    values = [*(recalls.get(key) for key in ("ar", *BOP_RECALLS))]
    values += [precision.get("ap"), precision.get("mssd_mm"), *seconds]
    return dict(zip(_NUMBERS, [result.frames, *values], strict=True))


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if len(known) == len(values) else None


def _cells(numbers: dict[str, float | None]) -> list[str]:
    return [format_share(numbers[name], _DIGITS.get(name, 3)) for name in _NUMBERS]
