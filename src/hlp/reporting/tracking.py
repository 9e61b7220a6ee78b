"""Log runs to MLflow. A run is opened before the work begins, so a crash leaves a FAILED run."""

import logging
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from hlp.errors import DataError, is_expected
from hlp.reporting.experiment_page import ExperimentPage
from hlp.reporting.local_database import owner_tags
from hlp.reporting.mlflow_client import Opened, connect, import_client, is_local, reason
from hlp.reporting.tracker import LoggedAs, Tracker, metric_name
from hlp.settings import Doc, Settings

if TYPE_CHECKING:
    from mlflow import MlflowClient

PARENT = "mlflow.parentRunId"  # tag of the runs of a sweep
REVISION = "mlflow.source.git.commit"
ARM = "hlp.arm"  # tag that tells the runs of a sweep apart
SEND_TO = "hlp.send_to"  # tags of a run that was kept here while its server was unreachable
CONTINUES = "hlp.continues"


@dataclass(frozen=True)
class TrackingSettings(Settings):
    """Config group `reporting`: runs in MLflow, or none."""

    name: Literal["mlflow", "none"] = "mlflow"
    uri: Annotated[
        str,
        Doc(
            "a local database file (sqlite:///FILE), or the address of a server; the default is"
            " MLFLOW_TRACKING_URI, if that is set"
        ),
    ] = "sqlite:///work/mlflow.db"
    experiment: Annotated[str, Doc("the MLflow experiment; by default `name`")] = "hlp"
    about: Annotated[str, Doc("what the experiment is, for its page in MLflow")] = ""
    unsent: Annotated[
        str, Doc("database that keeps runs while the server is away; `hlp upload` sends them")
    ] = "sqlite:///work/unsent/mlflow.db"


@dataclass(frozen=True)
class ChildRun:
    """One run of a sweep: its name, its parent's run id, and the values of the swept keys.

    `arm` tells it from the others of that parent; empty: the name does.
    """

    name: str
    parent: str
    swept: Mapping[str, str]
    arm: str = ""

    @property
    def tags(self) -> dict[str, str]:
        """The tags by which MLflow knows it."""
        return {PARENT: self.parent, ARM: self.arm or self.name}


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


@contextmanager
def track_run(
    settings: TrackingSettings,
    run_name: str,
    config: Mapping[str, Any],
    tags: Mapping[str, str] | None = None,
    resume: str | None = None,
    *,
    params: Mapping[str, str] | None = None,
    page: ExperimentPage | None = None,
) -> Iterator[Tracker]:
    """Open an MLflow run; it ends FINISHED, KILLED if interrupted, or FAILED with a traceback.

    `config` is the whole configuration, which becomes an artifact; `params` are the parameters,
    those that somebody has chosen. `tags` may hold the `REVISION` of the code, `page` what a new
    experiment's page says. Name and parent are those of `as_child_run` inside of it; the same child
    of the same parent is continued. `resume` continues the run of that id, or opens a new one if
    MLflow no longer has it. A local database is created on first use, with the folder for artifacts
    beside it. Runs that a dead process has left open are closed as KILLED. If a server is away, the
    run is kept in `settings.unsent`, with a warning.

    Raises ConfigError if MLflow cannot be used at `settings.uri`, DataError if it fails later.
    """
    if settings.name == "none":
        yield Tracker(None)
        return
    with _errors_named(settings.uri):
        about = (page or ExperimentPage(settings.about)).tags
        opened = connect(settings.uri, settings.experiment, about, settings.unsent)
        child = _CHILD.get()
        all_tags = {"mlflow.source.name": "hlp run", **owner_tags(), **(tags or {})}
        if opened.aside:
            all_tags[SEND_TO] = settings.uri
        if child is not None:
            run_name, resume = child.name, _same_child(opened, child)
            all_tags |= child.tags
            params = {**child.swept, **(params or {})}
        run, logged = _open_run(opened, run_name, all_tags, resume)

        def keep_aside() -> LoggedAs:
            away = connect(settings.unsent, settings.experiment, about, settings.unsent)
            kept = {**all_tags, SEND_TO: settings.uri, CONTINUES: run.run_id}
            return _open_run(away, run_name, kept, None)[0]

        remote = not is_local(settings.uri) and not opened.aside
        tracker = Tracker(run, keep_aside if remote else None)
        try:
            # MLflow lets no parameter be changed.
            wanted = {n: v for n, v in (params or {}).items() if metric_name(n) not in logged}
            tracker.log_params(wanted)
            whole = dict(config)
            tracker.send(lambda client, run_id: client.log_dict(run_id, whole, "config.yaml"))
            yield tracker
            tracker.send(lambda client, run_id: client.set_terminated(run_id, "FINISHED"))
        except Exception as error:
            _close(tracker, "FAILED", error)
            raise
        except BaseException:  # Ctrl-C, or an end asked for
            _close(tracker, "KILLED")
            raise


@contextmanager
def _errors_named(uri: str) -> Iterator[None]:
    """Raise MLflow's errors in the block as DataError, in one line."""
    import_client()
    from mlflow.exceptions import MlflowException

    try:
        yield
    except MlflowException as error:
        raise DataError(f"MLflow at {uri} failed: {reason(error)}") from error


def _close(tracker: Tracker, status: str, error: Exception | None = None) -> None:
    """End a run that did not end well. If MLflow fails too, only the log says so."""
    try:
        if error is not None:
            words, trace = f"{type(error).__name__}: {error}"[:500], traceback.format_exc()
            tracker.send(lambda client, run_id: client.set_tag(run_id, "error", words))
            tracker.send(lambda client, run_id: client.log_text(run_id, trace, "traceback.txt"))
        tracker.send(lambda client, run_id: client.set_terminated(run_id, status))
    except Exception as second:
        if error is None and not is_expected(second):
            raise
        logging.getLogger(__name__).warning("MLflow cannot be told: %s", reason(second))


def _open_run(
    opened: Opened, name: str, tags: Mapping[str, str], resume: str | None
) -> tuple[LoggedAs, Mapping[str, str]]:
    """A new run, or an ended one that goes on; and the parameters that it has."""
    logged = None if resume is None else _reopen(opened.client, resume)
    if resume is None or logged is None:
        created = opened.client.create_run(opened.experiment_id, run_name=name, tags=dict(tags))
        resume = str(created.info.run_id)
    return LoggedAs(opened.client, opened.experiment_id, resume), logged or {}


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


def _same_child(opened: Opened, child: ChildRun) -> str | None:
    """The id of this run of the sweep, if it was begun before."""
    own = f"tags.`{PARENT}` = '{child.parent}'"
    for run in opened.client.search_runs([opened.experiment_id], own):
        if run.data.tags.get(ARM) == child.tags[ARM]:
            return str(run.info.run_id)
    return None
