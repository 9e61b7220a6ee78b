"""`summary.json`: recalls, times and causes of misses of one run."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hlp.errors import DataError
from hlp.files import read_json, read_table, write_csv
from hlp.records import TargetScore

Summary = dict[str, Any]

CORRECT = "correct"
"""Stands beside the causes of misses in a waterfall."""
METRICS: dict[str, Callable[[TargetScore], bool]] = {
    "add": lambda score: score.add_correct,
    "5cm5deg": lambda score: score.pose_correct,
    "iou50": lambda score: score.box_correct,
}
"""Name of each metric in `summary.json`, and the verdict of a score that it counts."""

_REQUIRED = {"targets", "metrics", "per_object", "timing_ms", "waterfall"}


def read_summary(path: Path) -> Summary:
    """Read `summary.json`. Raises MissingFileError, and DataError if it is not one."""
    summary: Summary = read_json(path)
    if not isinstance(summary, dict) or (missing := _REQUIRED - summary.keys()):
        lacks = f": it lacks {', '.join(sorted(missing))}" if isinstance(summary, dict) else ""
        raise DataError(f"{path} is no summary of a run{lacks}")
    return summary


def average_recalls(scores: Sequence[TargetScore]) -> dict[str, float | None]:
    """Mean recalls `vsd`, `mssd` and `mspd` over targets, and `ar`, their mean.

    None where they were not computed for some target: VSD needs the frame's depth image. Source:
    BOP Challenge 2020, Sec. 2.2.
    """
    recalls = {
        "vsd": _mean_or_none([score.vsd_recall for score in scores]),
        "mssd": _mean_or_none([score.mssd_recall for score in scores]),
        "mspd": _mean_or_none([score.mspd_recall for score in scores]),
    }
    known = [value for value in recalls.values() if value is not None]
    complete = len(known) == len(recalls)
    return {"ar": float(np.mean(known)) if complete else None, **recalls}


def _mean_or_none(values: Sequence[float]) -> float | None:
    mean = float(np.mean(values))
    return None if np.isnan(mean) else mean


FILE = "targets.csv"
_COLUMNS = ("scene_id", "im_id", "obj_id", "instance", "object")

TargetKey = tuple[int, int, int, int]
"""Scene, image, object, and the instance of the object in the image (from 0)."""
TargetValues = Mapping[str, Mapping[TargetKey, float]]
"""Values by the name of the number, then by target; a target may lack some of them."""


def numbered_targets(targets: Iterable[tuple[int, int, int]]) -> list[TargetKey]:
    """Keys of targets that are named by scene, image and object, in their order.

    Several instances of an object in an image are told apart by that order.
    """
    instances: Counter[tuple[int, int, int]] = Counter()
    keys: list[TargetKey] = []
    for target in targets:
        keys.append((*target, instances[target]))
        instances[target] += 1
    return keys


def write_target_values(folder: Path, values: TargetValues, names: Mapping[int, str]) -> None:
    """Write targets.csv: one row per target, one column per number, empty where it has none.

    `names` are the objects' names by id; raises KeyError for an object that has none.
    """
    numbers = values.values()
    keys = sorted({key for by_target in numbers for key in by_target})
    rows = [[*key, names[key[2]], *(column.get(key, "") for column in numbers)] for key in keys]
    write_csv(folder / FILE, [*_COLUMNS, *values], rows)


def read_target_values(folder: Path) -> dict[str, dict[TargetKey, float]]:
    """What `write_target_values` has written; empty if the folder has no such file.

    Raises DataError naming the file, and the line that holds no numbers.
    """
    path = folder / FILE
    if not path.is_file():
        return {}
    names, rows = read_table(path, _COLUMNS)
    values: dict[str, dict[TargetKey, float]] = {name: {} for name in names}
    for line, row in enumerate(rows, start=2):
        try:
            scene, image, object_id, instance = (int(row[column]) for column in _COLUMNS[:4])
            found = {name: float(row[name]) for name in names if row[name] != ""}
        except (ValueError, TypeError) as error:
            raise DataError(f"{path}, line {line}: no target ({error})") from error
        if not all(map(math.isfinite, found.values())):
            raise DataError(f"{path}, line {line}: a value is not finite")
        for name, value in found.items():
            values[name][scene, image, object_id, instance] = value
    return values
