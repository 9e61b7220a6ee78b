"""Connecting to MLflow: a server, or a local database that is created on first use."""

import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from hlp.errors import ConfigError
from hlp.reporting.local_database import SQLITE, artifacts_uri, owner_is_dead, prepare_database

if TYPE_CHECKING:
    from mlflow import MlflowClient


@dataclass(frozen=True)
class Opened:
    """MLflow's client and the id of an experiment; `aside` if the server was unreachable."""

    client: "MlflowClient"
    experiment_id: str
    aside: bool = False


def is_local(uri: str) -> bool:
    """Whether an address is that of a local database."""
    return uri.startswith(SQLITE)


def connect(uri: str, experiment: str, tags: Mapping[str, str], unsent: str) -> Opened:
    """Open an experiment, which is created with these tags if need be.

    If the server is away, that of the local database `unsent`, with a warning. Runs that a dead
    process has left open are closed as KILLED. Raises ConfigError if MLflow cannot be used at this
    address.
    """
    import_client()
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError  # of a database that is being created

    try:
        if is_local(uri):
            return Opened(*_open_local(database_path(uri), experiment, tags))
        try:
            return Opened(*_open(uri, experiment, tags, None))
        except Exception as error:
            if not is_away(error):
                raise
        logging.getLogger(__name__).warning(
            "MLflow's server %s is away: the run is kept in %s; `hlp upload` sends it later",
            uri,
            database_path(unsent),
        )
        return Opened(*_open_local(database_path(unsent), experiment, tags), aside=True)
    except (MlflowException, SQLAlchemyError) as error:
        raise ConfigError(f"reporting.uri: MLflow cannot use {uri}: {reason(error)}") from error


def reason(error: BaseException) -> str:
    """The first line of a message that says why; SQLAlchemy begins with one that does not."""
    lines = [line for line in str(error).splitlines() if not line.startswith("(raised as a result")]
    return lines[0] if lines else type(error).__name__


def is_away(error: BaseException) -> bool:
    """Whether an error of MLflow's client says that its server did not answer."""
    import requests
    from mlflow.exceptions import MlflowException

    if isinstance(error, requests.ConnectionError | requests.Timeout):
        return True
    # The client wraps what it gets; an answer of the server is a subclass, RestException.
    return type(error) is MlflowException and str(error).startswith("API request to")


def follow_database(database: Path) -> None:
    """Prepare a local database for use where it lies now; see `prepare_database`."""
    import_client()
    try:
        database.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise ConfigError(f"reporting.uri: {database.parent} is no folder") from error
    # Processes that create the same SQLite database at the same time destroy it (MLflow 3).
    with FileLock(database.with_name(database.name + ".lock")):
        prepare_database(database)


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
    logging.getLogger("urllib3").setLevel(logging.ERROR)  # a line for each try of a server
    return MlflowClient


def database_path(uri: str) -> Path:
    """File of a local MLflow database."""
    return Path(uri.removeprefix(SQLITE)).absolute()


def _open_local(
    database: Path, experiment: str, tags: Mapping[str, str]
) -> tuple["MlflowClient", str]:
    follow_database(database)
    with FileLock(database.with_name(database.name + ".lock")):
        return _open(f"{SQLITE}{database}", experiment, tags, artifacts_uri(database))


def _open(
    uri: str, experiment: str, tags: Mapping[str, str], artifacts: str | None
) -> tuple["MlflowClient", str]:
    client = import_client()(uri, registry_uri=uri)
    found = client.get_experiment_by_name(experiment)
    if found is None:
        created = client.create_experiment(experiment, artifact_location=artifacts, tags=dict(tags))
        return client, str(created)
    for name, value in tags.items():  # somebody's own description stays
        if name not in found.tags:
            client.set_experiment_tag(found.experiment_id, name, value)
    for run in client.search_runs([found.experiment_id], "attributes.status = 'RUNNING'"):
        if owner_is_dead(run.data.tags):
            client.set_terminated(run.info.run_id, "KILLED")
    return client, str(found.experiment_id)
