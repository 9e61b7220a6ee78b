"""MLflow's local database: created whole, set aside if damaged, usable in another folder.

All of this happens under a lock, which the caller holds.
"""

import logging
import os
import platform
import shutil
import sqlite3
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from hlp.files import write_text

SQLITE = "sqlite:///"
ARTIFACTS = "mlflow-artifacts"
_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}
_COMPANIONS = ("", "-journal", "-wal", "-shm")


def prepare_database(database: Path) -> None:
    """Create the database unless it is there.

    It is created under another name and renamed, because MLflow can neither use nor complete one
    whose creation was cut off. A damaged one is renamed, and one that was moved or copied here gets
    the new path of its artifacts. Raises OSError if the folder cannot be written.
    """
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


def artifacts_uri(database: Path) -> str:
    """Where the artifacts of a database lie: in a folder beside it."""
    return (database.parent.resolve() / ARTIFACTS).as_uri()


def remove_database(database: Path) -> None:
    """Delete a database, its artifacts, and its folder unless that holds something else."""
    for ending in (*_COMPANIONS, ".lock"):
        Path(f"{database}{ending}").unlink(missing_ok=True)
    shutil.rmtree(database.parent / ARTIFACTS, ignore_errors=True)
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
    connection = sqlite3.connect(database)
    try:
        (found,) = connection.execute("pragma integrity_check(1)").fetchone()
    except sqlite3.DatabaseError as error:
        if error.sqlite_errorcode & 0xFF not in _DAMAGED:  # locked, or the disk is full
            return None
        return str(error)
    finally:
        connection.close()
    return None if found == "ok" else str(found).splitlines()[-1]


def _follow_move(database: Path) -> None:
    """Write the present place of the artifacts over that of before a move.

    MLflow stores absolute paths only.
    """
    now = artifacts_uri(database)
    connection = sqlite3.connect(database)
    try:
        places = connection.execute("select distinct artifact_location from experiments")
        for (before,) in places.fetchall():
            if before is None or before == now or not before.endswith(f"/{ARTIFACTS}"):
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
    except sqlite3.OperationalError:  # no such tables, read-only: MLflow says what it needs
        return
    finally:
        connection.close()


_HOST, _PROCESS, _STARTED = "hlp.host", "hlp.process", "hlp.process_started"


def owner_tags() -> dict[str, str]:
    """Tags that name this process: host, id, and when it started (another may get its id)."""
    own = os.getpid()
    return {_HOST: platform.node(), _PROCESS: str(own), _STARTED: _state_and_start(own)[1]}


def owner_is_dead(tags: Mapping[str, str]) -> bool:
    """Whether the process that a run's tags name has ended; False if that cannot be known."""
    number = tags.get(_PROCESS, "")
    if tags.get(_HOST) != platform.node() or not number.isdecimal() or sys.platform == "win32":
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
