"""Databases of MLflow for the tests of this folder: making one takes a second; cells of basins."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pandas as pd
import pytest

from hlp.reporting.mlflow.tracking import MlflowSettings
from hlp.reporting.study_tables import basin_cells


@pytest.fixture(scope="session", autouse=True)
def tables(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """MLflow makes the tables of the first database; those of the others are copied."""
    from mlflow.store.db import utils

    make, kept = utils._initialize_tables, tmp_path_factory.mktemp("tables") / "mlflow.db"

    def copy(engine: Any) -> None:
        database, source = engine.url.database, kept
        if not kept.exists():
            make(engine)
            source, database = database, kept
        with closing(sqlite3.connect(source)) as old, closing(sqlite3.connect(database)) as new:
            old.backup(new)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(utils, "_initialize_tables", copy)
        yield


@pytest.fixture(scope="session")
def settings(tmp_path_factory: pytest.TempPathFactory) -> MlflowSettings:
    uri = f"sqlite:///{tmp_path_factory.mktemp('tracking') / 'deep' / 'mlflow.db'}"
    return MlflowSettings(uri=uri, experiment="hlp")


RIGHT = {
    ("pso", "cup"): [[2, 2, 2], [2, 2, 2]],
    ("pso", "cat"): [[4, 3, 1], [2, 1, 0]],
    ("icp", "cup"): [[1, 1, 1], [1, 1, 1]],
    ("icp", "cat"): [[4, 4, 0], [0, 0, 0]],
}


@pytest.fixture(scope="session")
def basins() -> pd.DataFrame:
    """How many of 4 starts of the cat, and of 2 of the cup, are right in each cell."""
    tried = [
        (refiner, name, (0.0, 15.0)[i], (0.0, 10.0, 50.0)[j], number < right[i][j])
        for (refiner, name), right in RIGHT.items()
        for number in range(4 if name == "cat" else 2)
        for i, j in np.ndindex(2, 3)
    ]
    columns = ["refiner", "object", "rotation_deg", "translation_mm", "right"]
    return basin_cells(pd.DataFrame(tried, columns=columns))
