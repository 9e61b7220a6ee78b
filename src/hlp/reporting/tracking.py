"""Runs in MLflow. A run is opened before any work is done, so that a crash leaves a FAILED row."""

import json
import logging
import os
import re
import shlex
import sys
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock

if TYPE_CHECKING:
    from mlflow import MlflowClient

LONGEST_PARAMETER = 6000  # MLflow's own limit
PARAMETERS_AT_ONCE = 100  # likewise
LONGEST_DIGEST = 36  # likewise
PARENT = "mlflow.parentRunId"  # tag of a sweep's arms
REVISION = "mlflow.source.git.commit"
SQLITE = "sqlite:///"


@dataclass(frozen=True)
class TrackingSettings:
    """Config group `reporting`: the database or server `uri`, and the MLflow `experiment`."""

    name: str
    uri: str
    experiment: str


@dataclass(frozen=True)
class Arm:
    """One run of a sweep: its name, its parent's id, and the keys that the sweep changes."""

    name: str
    parent: str
    swept: Mapping[str, str]


_ARM: ContextVar[Arm | None] = ContextVar("arm", default=None)


@contextmanager
def as_arm(arm: Arm) -> Iterator[None]:
    """Runs opened meanwhile are this arm: what opens them need not know of sweeps."""
    token = _ARM.set(arm)
    try:
        yield
    finally:
        _ARM.reset(token)


class Tracker:
    """One MLflow run. Names may be anything: characters that MLflow refuses become `_`."""

    def __init__(self, client: "MlflowClient", experiment_id: str, run_id: str) -> None:
        self._client = client
        self.experiment_id = experiment_id
        self.run_id = run_id

    @property
    def page(self) -> str:
        """Path of the run's page below the address of MLflow's server."""
        return f"/#/experiments/{self.experiment_id}/runs/{self.run_id}"

    def log_metrics(self, metrics: Mapping[str, float | None], step: int = 0) -> None:
        """Log numbers at once, e.g. `add/recall`; None (nothing measured) is left out."""
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [
            Metric(metric_name(name), float(value), now, step)
            for name, value in metrics.items()
            if value is not None
        ]
        self._client.log_batch(self.run_id, metrics=entries)

    def log_epoch_metrics(self, stage: str, epoch: int, metrics: Mapping[str, float]) -> None:
        """Log one epoch of a stage's training as `<stage>/<name>`: a call an epoch, none a step."""
        self.log_metrics({f"{stage}/{name}": value for name, value in metrics.items()}, epoch)

    def log_params(self, params: Mapping[str, Any]) -> None:
        """Log a nested configuration as flat parameters, values cut at MLflow's limit."""
        from mlflow.entities import Param

        entries = [
            Param(metric_name(name), str(value)[:LONGEST_PARAMETER])
            for name, value in flatten(params).items()
        ]
        for start in range(0, len(entries), PARAMETERS_AT_ONCE):
            self._client.log_batch(self.run_id, params=entries[start : start + PARAMETERS_AT_ONCE])

    def log_input(self, name: str, digest: str, source: str, context: str) -> None:
        """Log a data set that the run reads: `digest` of its content, and what it is read for."""
        from mlflow.entities import Dataset, DatasetInput, InputTag

        data = Dataset(name, digest[:LONGEST_DIGEST], "local", json.dumps({"uri": source}))
        tags = [InputTag("mlflow.data.context", context)]
        self._client.log_inputs(self.run_id, datasets=[DatasetInput(data, tags)])

    def log_artifact(self, path: Path, folder: str | None = None) -> None:
        """Copy a file into the run's artifacts; raises FileNotFoundError where there is none."""
        if not path.is_file():
            raise FileNotFoundError(f"no file {path} to log")
        self._client.log_artifact(self.run_id, str(path), folder)

    def log_artifacts(self, path: Path, folder: str | None = None) -> None:
        """Copy what is in a folder into the run's artifacts (below `folder`)."""
        if not path.is_dir():
            raise FileNotFoundError(f"no folder {path} to log")
        self._client.log_artifacts(self.run_id, str(path), folder)

    def log_table(self, name: str, columns: Mapping[str, Sequence[Any]]) -> None:
        """Log a table that MLflow's page shows, as `<name>.json`."""
        data = {column: list(values) for column, values in columns.items()}
        self._client.log_table(self.run_id, data, f"{name}.json")


@contextmanager
def track_run(
    settings: TrackingSettings,
    run_name: str,
    params: Mapping[str, Any],
    tags: Mapping[str, str] | None = None,
    resume: str | None = None,
) -> Iterator[Tracker]:
    """Open an MLflow run; it ends FINISHED, KILLED if interrupted, or FAILED with a traceback.

    `params` is the run's configuration; `tags` may name the `REVISION` of the code. An `as_arm`
    around it decides the name, and the parent. With `resume`, the run of that id goes on instead of
    a new one, unless MLflow has it no more. A local database is made on first use, together with
    the folder for artifacts beside it.
    """
    client, experiment_id = _connect(settings)
    all_tags = {"mlflow.source.name": "hlp run", **(tags or {})}
    arm = _ARM.get()
    if arm is not None:
        run_name, all_tags[PARENT] = arm.name, arm.parent
    run_id = resume
    goes_on = run_id is not None and _goes_on(client, run_id)
    if run_id is None or not goes_on:
        run_id = client.create_run(experiment_id, run_name=run_name, tags=all_tags).info.run_id
    tracker = Tracker(client, experiment_id, run_id)
    try:
        if not goes_on:  # MLflow lets none be changed, and a run that goes on has its own
            tracker.log_params({**(arm.swept if arm else {}), **flatten(params)})
        client.log_dict(run_id, dict(params), "config.yaml")
        yield tracker
    except Exception as error:
        client.set_tag(tracker.run_id, "error", f"{type(error).__name__}: {error}"[:500])
        client.log_text(tracker.run_id, traceback.format_exc(), "traceback.txt")
        client.set_terminated(tracker.run_id, "FAILED")
        raise
    except BaseException:  # Ctrl-C, or an exit asked for
        client.set_terminated(tracker.run_id, "KILLED")
        raise
    client.set_terminated(tracker.run_id, "FINISHED")


def _goes_on(client: "MlflowClient", run_id: str) -> bool:
    """Have a run that ended be running again; False where MLflow does not have it."""
    from mlflow.exceptions import MlflowException

    try:
        run = client.get_run(run_id)
    except MlflowException as error:
        if error.error_code != "RESOURCE_DOES_NOT_EXIST":
            raise
        return False
    if "error" in run.data.tags:
        client.delete_tag(run_id, "error")
    client.update_run(run_id, status="RUNNING")
    return True


def how_to_browse(settings: TrackingSettings, tracker: Tracker) -> str:
    """What to start and which page to open to see a run, for a person at a terminal."""
    if not settings.uri.startswith(SQLITE):
        return f"{settings.uri.rstrip('/')}{tracker.page}"
    address = shlex.quote(f"{SQLITE}{database_path(settings)}")
    server = f"{shlex.quote(sys.executable)} -m mlflow server --workers 1"
    return f"{server} --backend-store-uri {address}\nthen open http://127.0.0.1:5000{tracker.page}"


def metric_name(name: str) -> str:
    """The name with all that MLflow refuses (@, brackets, %, …) replaced by `_`."""
    return re.sub(r"[^\w\-. :/]", "_", name)


def flatten(nested: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Join the keys of nested mappings with dots: {"a": {"b": 1}} → {"a.b": 1}."""
    flat: dict[str, Any] = {}
    for key, value in nested.items():
        if isinstance(value, Mapping) and value:
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _connect(settings: TrackingSettings) -> tuple["MlflowClient", str]:
    """MLflow's client and the id of the experiment, made if need be.

    Processes that create one SQLite database at the same time spoil it (MLflow 3), so the first
    contact with a local one, which the client's construction is, is made under a lock.
    """
    import_client()
    if not settings.uri.startswith(SQLITE):
        return _open(settings, None)
    database = database_path(settings)
    database.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(database.with_name(database.name + ".lock")):
        return _open(settings, (database.parent / "mlflow-artifacts").as_uri())


def import_client() -> type["MlflowClient"]:
    """Import MLflow, which takes seconds, without its telemetry and its talk of databases."""
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # read when mlflow is imported
    from mlflow import MlflowClient

    for name in ("mlflow", "alembic"):
        logging.getLogger(name).setLevel(logging.WARNING)
    return MlflowClient


def database_path(settings: TrackingSettings) -> Path:
    """File of a local database."""
    return Path(settings.uri.removeprefix(SQLITE)).absolute()


def _open(settings: TrackingSettings, artifacts: str | None) -> tuple["MlflowClient", str]:
    client = import_client()(settings.uri, registry_uri=settings.uri)
    found = client.get_experiment_by_name(settings.experiment)
    if found is not None:
        return client, str(found.experiment_id)
    return client, str(client.create_experiment(settings.experiment, artifact_location=artifacts))
