"""Log runs to MLflow. A run is opened before the work begins, so a crash leaves a FAILED run."""

import json
import logging
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
from typing import TYPE_CHECKING, Annotated, Any, Literal

from hlp.errors import DataError, MissingFileError, is_expected
from hlp.reporting.local_database import SQLITE
from hlp.reporting.mlflow_client import connect, database_path, import_client, is_local
from hlp.reporting.run_owner import owner_tags
from hlp.settings import Doc, Settings

if TYPE_CHECKING:
    from mlflow import MlflowClient

LONGEST_PARAMETER = 6000  # MLflow's own limit
PARAMETERS_AT_ONCE = 100  # likewise
LONGEST_DIGEST = 36  # likewise
PARENT = "mlflow.parentRunId"  # tag of the runs of a sweep
REVISION = "mlflow.source.git.commit"


@dataclass(frozen=True)
class TrackingSettings(Settings):
    """Config group `reporting`: runs in MLflow."""

    name: Literal["mlflow"] = "mlflow"
    uri: Annotated[
        str, Doc("a local database file (sqlite:///FILE), or the address of a server")
    ] = "sqlite:///work/mlflow.db"
    experiment: Annotated[str, Doc("the MLflow experiment")] = "hlp"


@dataclass(frozen=True)
class ChildRun:
    """One run of a sweep: its name, its parent's run id, and the values of the swept keys."""

    name: str
    parent: str
    swept: Mapping[str, str]


_CHILD: ContextVar[ChildRun | None] = ContextVar("child", default=None)


@contextmanager
def as_child_run(child: ChildRun) -> Iterator[None]:
    """Log runs that are opened meanwhile as this run of a sweep.

    So the code that opens a run need not know about sweeps.
    """
    token = _CHILD.set(child)
    try:
        yield
    finally:
        _CHILD.reset(token)


class Tracker:
    """One MLflow run. In names, characters that MLflow refuses are replaced by `_`."""

    def __init__(self, client: "MlflowClient", experiment_id: str, run_id: str) -> None:
        self._client = client
        self.experiment_id = experiment_id
        self.run_id = run_id

    @property
    def page_path(self) -> str:
        """Path of the run's page, to be appended to the address of MLflow's server."""
        return f"/#/experiments/{self.experiment_id}/runs/{self.run_id}"

    def log_metrics(self, metrics: Mapping[str, float | None], step: int = 0) -> None:
        """Log several numbers in one call, e.g. `add/recall`; None (not measured) is left out."""
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [
            Metric(metric_name(name), float(value), now, step)
            for name, value in metrics.items()
            if value is not None
        ]
        self._client.log_batch(self.run_id, metrics=entries)

    def log_epoch_metrics(self, stage: str, epoch: int, metrics: Mapping[str, float]) -> None:
        """Log one epoch of a stage's training as `<stage>/<name>`, in one call."""
        self.log_metrics({f"{stage}/{name}": value for name, value in metrics.items()}, epoch)

    def log_params(self, params: Mapping[str, Any]) -> None:
        """Log a nested configuration as flat parameters; long values are cut at MLflow's limit."""
        from mlflow.entities import Param

        entries = [
            Param(metric_name(name), str(value)[:LONGEST_PARAMETER])
            for name, value in flatten(params).items()
        ]
        for start in range(0, len(entries), PARAMETERS_AT_ONCE):
            self._client.log_batch(self.run_id, params=entries[start : start + PARAMETERS_AT_ONCE])

    def log_input(self, name: str, digest: str, source: str, context: str) -> None:
        """Log a data set that the run reads, with a `digest` of its content and its purpose."""
        from mlflow.entities import Dataset, DatasetInput, InputTag

        data = Dataset(name, digest[:LONGEST_DIGEST], "local", json.dumps({"uri": source}))
        tags = [InputTag("mlflow.data.context", context)]
        self._client.log_inputs(self.run_id, datasets=[DatasetInput(data, tags)])

    def log_artifact(self, path: Path, folder: str | None = None) -> None:
        """Copy a file into the run's artifacts. Raises FileNotFoundError if it does not exist."""
        if not path.is_file():
            raise MissingFileError(f"no file {path} to log")
        self._client.log_artifact(self.run_id, str(path), folder)

    def log_artifacts(self, path: Path, folder: str | None = None) -> None:
        """Copy a folder's content into the run's artifacts, below `folder`.

        Raises FileNotFoundError if it does not exist.
        """
        if not path.is_dir():
            raise MissingFileError(f"no folder {path} to log")
        self._client.log_artifacts(self.run_id, str(path), folder)

    def log_table(self, name: str, columns: Mapping[str, Sequence[Any]]) -> None:
        """Log a table, as `<name>.json`, which MLflow's pages show."""
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

    `params` is the run's configuration; `tags` may hold the `REVISION` of the code. Name and parent
    are those of `as_child_run` inside of it; a child that did not end well before is continued.
    `resume` continues the run of that id, or opens a new one if MLflow no longer has it. A local
    database is created on first use, with the folder for artifacts beside it. Runs that a dead
    process has left open are closed as KILLED.

    Raises ConfigError if MLflow cannot be reached at `settings.uri`, DataError if it fails later.
    """
    with _errors_named(settings.uri):
        client, experiment_id = connect(settings.uri, settings.experiment)
        all_tags = {"mlflow.source.name": "hlp run", **owner_tags(), **(tags or {})}
        child = _CHILD.get()
        if child is not None:
            run_name, all_tags[PARENT] = child.name, child.parent
            resume = _unfinished_child(client, experiment_id, child)
        logged = None if resume is None else _reopen(client, resume)
        if resume is None or logged is None:
            resume = client.create_run(experiment_id, run_name=run_name, tags=all_tags).info.run_id
        run_id, logged = resume, logged or {}
        tracker = Tracker(client, experiment_id, run_id)
        with _closed(client, run_id):
            wanted = {**(child.swept if child else {}), **flatten(params)}
            # MLflow lets no parameter be changed.
            tracker.log_params({n: v for n, v in wanted.items() if metric_name(n) not in logged})
            client.log_dict(run_id, dict(params), "config.yaml")
            yield tracker


@contextmanager
def _errors_named(uri: str) -> Iterator[None]:
    """Raise MLflow's errors in the block as DataError, in one line."""
    import_client()
    from mlflow.exceptions import MlflowException

    try:
        yield
    except MlflowException as error:
        raise DataError(f"MLflow at {uri} failed: {_first_line(error)}") from error


@contextmanager
def _closed(client: "MlflowClient", run_id: str) -> Iterator[None]:
    """End the run with the block: FINISHED, FAILED after an error, KILLED if it was stopped."""
    try:
        yield
    except Exception as error:
        _close(client, run_id, "FAILED", error)
        raise
    except BaseException:  # Ctrl-C, or an end asked for
        _close(client, run_id, "KILLED")
        raise
    client.set_terminated(run_id, "FINISHED")


def _close(
    client: "MlflowClient", run_id: str, status: str, error: Exception | None = None
) -> None:
    """End a run that did not end well. If MLflow fails too, only the log says so."""
    try:
        if error is not None:
            client.set_tag(run_id, "error", f"{type(error).__name__}: {error}"[:500])
            client.log_text(run_id, traceback.format_exc(), "traceback.txt")
        client.set_terminated(run_id, status)
    except Exception as second:
        if error is None and not is_expected(second):
            raise
        logging.getLogger(__name__).warning("MLflow cannot be told: %s", _first_line(second))


def _first_line(error: BaseException) -> str:
    return str(error).partition("\n")[0]


def _reopen(client: "MlflowClient", run_id: str) -> Mapping[str, str] | None:
    """Set an ended run to running again; its parameters, or None if MLflow does not have it."""
    from mlflow.exceptions import MlflowException

    try:
        run = client.get_run(run_id)
    except MlflowException as error:
        if error.error_code not in ("RESOURCE_DOES_NOT_EXIST", "INVALID_PARAMETER_VALUE"):
            raise
        return None
    if "error" in run.data.tags:
        client.delete_tag(run_id, "error")
    for name, value in owner_tags().items():
        client.set_tag(run_id, name, value)
    client.update_run(run_id, status="RUNNING")
    return dict(run.data.params)


def _unfinished_child(client: "MlflowClient", experiment_id: str, child: ChildRun) -> str | None:
    """The id of this run of the sweep, if it was begun before and did not end well."""
    found = client.search_runs([experiment_id], f"tags.`{PARENT}` = '{child.parent}'")
    for run in found:
        if run.info.run_name == child.name and run.info.status in ("FAILED", "KILLED"):
            return str(run.info.run_id)
    return None


def how_to_browse(settings: TrackingSettings, tracker: Tracker) -> str:
    """The command to start and the page to open to see a run, for a person at a terminal."""
    if not is_local(settings.uri):
        return f"{settings.uri.rstrip('/')}{tracker.page_path}"
    address = shlex.quote(f"{SQLITE}{database_path(settings.uri)}")
    server = f"{shlex.quote(sys.executable)} -m mlflow server --workers 1 --host 127.0.0.1"
    return f"{server} --backend-store-uri {address}\nthen open http://127.0.0.1:5000{tracker.page_path}"


def metric_name(name: str) -> str:
    """The name with all characters that MLflow refuses (@, brackets, %, …) replaced by `_`."""
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
