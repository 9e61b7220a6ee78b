"""Databases of MLflow for the tests of this folder: making one takes a second."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from hlp.reporting.mlflow.tracking import MlflowSettings


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
def mlflow_settings(tmp_path_factory: pytest.TempPathFactory) -> MlflowSettings:
    uri = f"sqlite:///{tmp_path_factory.mktemp('tracking') / 'deep' / 'mlflow.db'}"
    return MlflowSettings(uri=uri, experiment="hlp")
