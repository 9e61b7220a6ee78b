"""MLflow's server for the runs of a local database: light, on this machine alone."""

import os
import shlex
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from urllib.request import urlopen

from hlp.errors import InputError, MissingFileError, NetworkError
from hlp.reporting.experiment_page import experiment_path
from hlp.reporting.local_database import SQLITE, artifacts_uri
from hlp.reporting.mlflow_client import database_path, follow_database, import_client, is_local
from hlp.reporting.tracker import Tracker

HOST, PORT = "127.0.0.1", 5000
_LONGEST_START = 300  # s
_SHUTDOWN = 10  # s


def how_to_browse(uri: str, tracker: Tracker) -> str:
    """The command to start and the page to open to see a run, for a person at a terminal.

    Empty without MLflow.
    """
    if tracker.run is None:
        return ""
    if not is_local(uri):
        return f"{uri.rstrip('/')}{tracker.page_path}"
    address = shlex.quote(f"uri={SQLITE}{database_path(uri)}")
    return f"hlp ui {address}\nthen http://{HOST}:{PORT}{tracker.page_path}"


def newest_page(uri: str, experiment: str | None = None) -> str:
    """Path of the page of the experiment with the newest run, or of the one of that name.

    Raises MissingFileError without a database or any run, InputError for an unknown experiment.
    """
    if is_local(uri):
        if not database_path(uri).is_file():
            raise MissingFileError(f"no runs in {database_path(uri)} yet: `hlp run` makes one")
        follow_database(database_path(uri))
    client = import_client()(uri)
    experiments = {each.name: each.experiment_id for each in client.search_experiments()}
    if experiment is not None:
        if experiment not in experiments:
            known = ", ".join(sorted(experiments))
            raise InputError(f"no experiment '{experiment}' in {uri}: there are {known}")
        return experiment_path(experiments[experiment])
    newest = client.search_runs(
        list(experiments.values()), order_by=["attributes.start_time DESC"], max_results=1
    )
    if not newest:
        raise MissingFileError(f"no runs in {uri} yet: `hlp run` makes one")
    return experiment_path(newest[0].info.experiment_id)


@contextmanager
def server(uri: str, port: int = PORT) -> Iterator[str]:
    """MLflow's server of a local database while the block runs; its address.

    One worker, no jobs: two processes instead of ten. It serves no other machine. Raises
    InputError for a port that is taken, NetworkError if the server does not start.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise InputError(f"port {port} is taken: choose another with port=N") from error
    light = {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_DISABLE_TELEMETRY": "true"}
    command = [sys.executable, "-m", "mlflow", "server", "--workers", "1", "--host", HOST]
    database = database_path(uri)
    command += ["--port", str(port), "--backend-store-uri", f"{SQLITE}{database}"]
    command += ["--artifacts-destination", artifacts_uri(database)]
    process = subprocess.Popen(  # noqa: S603 - all words stand above or are checked
        command,
        env={**os.environ, **light},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        address = f"http://{HOST}:{port}"
        _wait(process, address)
        yield address
    finally:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_SHUTDOWN)
        process.kill()


def _wait(process: "subprocess.Popen[bytes]", address: str) -> None:
    """Until the server answers."""
    end = time.monotonic() + _LONGEST_START
    while time.monotonic() < end:
        if process.poll() is not None:
            raise NetworkError(f"MLflow's server ended with {process.returncode}")
        with suppress(OSError), urlopen(f"{address}/health", timeout=5):  # noqa: S310 - ours
            return
        time.sleep(0.2)
    raise NetworkError(f"MLflow's server did not answer within {_LONGEST_START} s")
