"""Connecting to MLflow: a server, or a local database that is created on first use."""

import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from hlp.errors import ConfigError
from hlp.reporting.local_database import SQLITE, artifacts_uri, prepare_database
from hlp.reporting.run_owner import owner_is_dead

if TYPE_CHECKING:
    from mlflow import MlflowClient


def is_local(uri: str) -> bool:
    """Whether an address is that of a local database."""
    return uri.startswith(SQLITE)


def connect(uri: str, experiment: str) -> tuple["MlflowClient", str]:
    """MLflow's client and the id of the experiment, which is created if need be.

    Processes that create the same SQLite database at the same time destroy it (MLflow 3), so that
    happens under a lock. Runs that a dead process has left open are closed as KILLED. Raises
    ConfigError if MLflow cannot be used at this address.
    """
    import_client()
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError  # of a database that is being created

    try:
        if not is_local(uri):
            return _open(uri, experiment, None)
        database = database_path(uri)
        try:
            database.parent.mkdir(parents=True, exist_ok=True)
        except FileExistsError as error:
            raise ConfigError(f"reporting.uri: {database.parent} is no folder") from error
        with FileLock(database.with_name(database.name + ".lock")):
            prepare_database(database)
            return _open(uri, experiment, artifacts_uri(database))
    except (MlflowException, SQLAlchemyError) as error:
        why = str(error).partition("\n")[0]
        raise ConfigError(f"reporting.uri: MLflow cannot use {uri}: {why}") from error


def import_client() -> type["MlflowClient"]:
    """Import MLflow, which takes seconds, with telemetry off and its database messages silenced."""
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # read when mlflow is imported
    # A dead server is noticed in seconds, not after seven retries of two minutes each.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")
    from mlflow import MlflowClient

    for name in ("mlflow", "alembic"):
        logging.getLogger(name).setLevel(logging.WARNING)
    # It prints the statement that failed, in many lines; the error that follows is said in one.
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.CRITICAL)
    return MlflowClient


def database_path(uri: str) -> Path:
    """File of a local MLflow database."""
    return Path(uri.removeprefix(SQLITE)).absolute()


def _open(uri: str, experiment: str, artifacts: str | None) -> tuple["MlflowClient", str]:
    client = import_client()(uri, registry_uri=uri)
    found = client.get_experiment_by_name(experiment)
    if found is None:
        return client, str(client.create_experiment(experiment, artifact_location=artifacts))
    for run in client.search_runs([found.experiment_id], "attributes.status = 'RUNNING'"):
        if owner_is_dead(run.data.tags):
            client.set_terminated(run.info.run_id, "KILLED")
    return client, str(found.experiment_id)
