"""Runs in MLflow; here where it keeps them: on a server, or in a local database made on first use.

A local database is made whole, set aside if it is damaged, and usable in another folder.
"""

import logging
import os
import platform
import shutil
import sqlite3
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from hlp.errors import ConfigError
from hlp.files import write_text

if TYPE_CHECKING:
    from mlflow import MlflowClient

SQLITE = "sqlite:///"
VIEWS = "mlflow.sharedViewState."  # tags of the views of an experiment, which links ask for
_ARTIFACTS = "mlflow-artifacts"
_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}
_COMPANIONS = ("", "-journal", "-wal", "-shm")
_HOST, _PROCESS, _STARTED = "hlp.host", "hlp.process", "hlp.process_started"


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


def is_local(uri: str) -> bool:
    """Whether an address is that of a local database."""
    return uri.startswith(SQLITE)


def database_path(uri: str) -> Path:
    """File of a local MLflow database."""
    return Path(uri.removeprefix(SQLITE)).absolute()


def artifacts_uri(database: Path) -> str:
    """Where the artifacts of a database lie: in a folder beside it."""
    return (database.parent.resolve() / _ARTIFACTS).as_uri()


def open_experiment(
    uri: str, experiment: str, tags: Mapping[str, str]
) -> tuple["MlflowClient", str]:
    """MLflow's client, and the id of an experiment, which is created with these tags if need be.

    Runs that a dead process has left open are closed as KILLED. Raises ConfigError if MLflow cannot
    be used at this address, and the client's own error if a server is unreachable.
    """
    client_of = import_client()
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError  # of a database that is being created

    try:
        if not is_local(uri):
            return _open(client_of(uri, registry_uri=uri), experiment, tags, None)
        database = database_path(uri)
        prepare_database(database)
        whole = f"{SQLITE}{database}"
        with _locked(database):
            client = client_of(whole, registry_uri=whole)
            return _open(client, experiment, tags, artifacts_uri(database))
    except (MlflowException, SQLAlchemyError) as error:
        if is_unreachable(error):
            raise
        raise ConfigError(f"reporting.uri: MLflow cannot use {uri}: {reason(error)}") from error


def _open(
    client: "MlflowClient", experiment: str, tags: Mapping[str, str], artifacts: str | None
) -> tuple["MlflowClient", str]:
    found = client.get_experiment_by_name(experiment)
    if found is None:
        created = client.create_experiment(experiment, artifact_location=artifacts, tags=dict(tags))
        return client, str(created)
    for name, value in tags.items():  # somebody's own description stays
        if name not in found.tags or name.startswith(VIEWS):
            client.set_experiment_tag(found.experiment_id, name, value)
    for run in client.search_runs([found.experiment_id], "attributes.status = 'RUNNING'"):
        if owner_is_dead(run.data.tags):
            client.set_terminated(run.info.run_id, "KILLED")
    return client, str(found.experiment_id)


def reason(error: BaseException) -> str:
    """The first line of a message that says why; SQLAlchemy begins with one that does not."""
    lines = [line for line in str(error).splitlines() if not line.startswith("(raised as a result")]
    return lines[0] if lines else type(error).__name__


def is_unreachable(error: BaseException) -> bool:
    """Whether an error of MLflow's client says that its server did not answer."""
    import requests
    from mlflow.exceptions import MlflowException

    if isinstance(error, requests.ConnectionError | requests.Timeout):
        return True
    # The client wraps what it gets; an answer of the server is a subclass, RestException.
    return type(error) is MlflowException and str(error).startswith("API request to")


def prepare_database(database: Path) -> None:
    """Create a local database unless it is there, and make it usable where it lies now.

    It is created under another name and renamed, because MLflow can neither use nor complete one
    whose creation was cut off. A damaged one is renamed, and one that was moved or copied here gets
    the new path of its artifacts. Raises ConfigError if its folder is a file, OSError if that
    cannot be written.
    """
    import_client()
    try:
        database.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise ConfigError(f"reporting.uri: {database.parent} is not a folder") from error
    with _locked(database):
        if database.exists() and database.stat().st_size > 0:
            problem = _problem(database)
            if problem is None:
                _follow_move(database)
                return
            aside = database.with_name(database.name + ".damaged")
            logging.getLogger(__name__).warning(
                "%s is damaged (%s): kept as %s, a new one begins", database, problem, aside.name
            )
            for ending in _COMPANIONS:
                if Path(f"{database}{ending}").exists():
                    os.replace(f"{database}{ending}", f"{aside}{ending}")
        _create(database)


def _locked(database: Path) -> FileLock:
    """Processes that create the same SQLite database at the same time destroy it (MLflow 3)."""
    return FileLock(database.with_name(database.name + ".lock"))


def remove_database(database: Path) -> None:
    """Delete a database, its artifacts, and its folder unless that holds something else."""
    for ending in (*_COMPANIONS, ".lock"):
        Path(f"{database}{ending}").unlink(missing_ok=True)
    shutil.rmtree(database.parent / _ARTIFACTS, ignore_errors=True)
    with suppress(OSError):
        database.parent.rmdir()


def _create(database: Path) -> None:
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

    fresh = database.with_name(f".{database.name}.new")
    for ending in _COMPANIONS:
        Path(f"{fresh}{ending}").unlink(missing_ok=True)  # of a creation that was cut off
    write_text(fresh, "")  # its errors are the system's own, those of MLflow are not
    store = SqlAlchemyStore(  # type: ignore[no-untyped-call]
        f"{SQLITE}{fresh}", artifacts_uri(database)
    )
    store.engine.dispose()
    os.replace(fresh, database)


def _problem(database: Path) -> str | None:
    """What SQLite finds damaged in a database."""
    if database.is_dir():
        return "it is a folder"
    with closing(sqlite3.connect(database)) as connection:
        try:
            (found,) = connection.execute("pragma integrity_check(1)").fetchone()
        except sqlite3.DatabaseError as error:
            damaged = error.sqlite_errorcode & 0xFF in _DAMAGED  # else locked, or the disk is full
            return str(error) if damaged else None
    return None if found == "ok" else str(found).splitlines()[-1]


def _follow_move(database: Path) -> None:
    """Replace the artifacts' place before a move, since MLflow stores absolute paths only."""
    now = artifacts_uri(database)
    # Without its tables, or where it may only be read, MLflow says itself what it needs.
    with closing(sqlite3.connect(database)) as connection, suppress(sqlite3.OperationalError):
        places = connection.execute("select distinct artifact_location from experiments")
        for (before,) in places.fetchall():
            if before is None or before == now or not before.endswith(f"/{_ARTIFACTS}"):
                continue
            connection.execute(
                "update experiments set artifact_location = ? where artifact_location = ?",
                (now, before),
            )
            connection.execute(
                "update runs set artifact_uri = ? || substr(artifact_uri, ?) "
                "where substr(artifact_uri, 1, ?) = ?",
                (now, len(before) + 1, len(before) + 1, f"{before}/"),
            )
        connection.commit()


def owner_tags() -> dict[str, str]:
    """Tags that name this process: host, id, and when it started (another may get its id)."""
    own = os.getpid()
    return {_HOST: platform.node(), _PROCESS: str(own), _STARTED: _state_and_start(own)[1]}


def owner_is_dead(tags: Mapping[str, str]) -> bool:
    """Whether the process that a run's tags name has ended; False if that cannot be known."""
    number = tags.get(_PROCESS, "")
    if tags.get(_HOST) != platform.node() or not number.isdecimal():
        return False
    try:
        os.kill(int(number), 0)
    except (ProcessLookupError, OverflowError):
        return True
    except PermissionError:
        pass  # it is another user's
    state, started = _state_and_start(int(number))
    return state == "Z" or started != tags.get(_STARTED, "")


def _state_and_start(process: int) -> tuple[str, str]:
    """State and start time (ticks since boot) of a process on Linux; empty elsewhere."""
    try:
        text = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return "", ""
    fields = text.rpartition(")")[2].split()  # its name, in brackets, may have blanks
    return fields[0], fields[19]
