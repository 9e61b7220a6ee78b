"""What a training leaves in its folder: a network's weights, and the metrics of each epoch.

Reading them imports neither torch nor Lightning, which take seconds, until weights are read.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.errors import DataError

if TYPE_CHECKING:
    from torch import Tensor

HISTORY = "history.csv"
WEIGHTS = "weights.safetensors"


@dataclass(frozen=True)
class StartingWeights:
    """A classifier of fewer objects to start from: its weights, and the new labels of its classes.

    It is trained further for `epochs`.
    """

    weights: Mapping[str, "Tensor"]
    labels: Mapping[int, int]
    epochs: int


def read_weights(folder: Path) -> dict[str, "Tensor"]:
    """A network's weights by name. Raises FileNotFoundError if there are none."""
    from safetensors.torch import load_file

    return load_file(folder / WEIGHTS)


def read_history(folder: Path) -> list[dict[str, float]]:
    """Metrics of every epoch, in order; empty if nothing was trained. Raises DataError."""
    path = folder / HISTORY
    if not path.exists():
        return []
    rows: list[dict[str, float]] = []
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream):
                rows.append({name: float(value) for name, value in row.items()})
    except (ValueError, TypeError, csv.Error) as error:
        where = f"{path}, line {len(rows) + 2}"
        raise DataError(f"{where}: no metrics of an epoch ({error})") from error
    return rows
