"""`targets.csv`: the numbers of a study target by target, so that two studies can be paired."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from hlp.errors import DataError
from hlp.files import read_table, write_csv

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
    """Write targets.csv: a row a target, a column for each number, empty where it has none.

    `names` are the objects' names by id; raises KeyError for an object that has none.
    """
    keys = sorted({key for each in values.values() for key in each})
    rows = [[*key, names[key[2]], *(each.get(key, "") for each in values.values())] for key in keys]
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
