"""Log runs to MLflow. A run is opened before the work begins, so a crash leaves a FAILED run."""

import logging
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from hlp.errors import DataError, is_expected
from hlp.reporting.mlflow import (
    database_path,
    import_client,
    is_local,
    is_unreachable,
    open_experiment,
    owner_tags,
    reason,
)
from hlp.reporting.mlflow.pages import experiment_tags
from hlp.reporting.mlflow.run import LoggedAs, MlflowRun, metric_name
from hlp.settings import Doc, Settings

if TYPE_CHECKING:
    from mlflow import MlflowClient

PARENT = "mlflow.parentRunId"  # tag of the runs of a sweep
REVISION = "mlflow.source.git.commit"
_PLACE = "hlp.sweep_run"  # tag that tells the runs of a sweep apart
SEND_TO = "hlp.send_to"  # tags of a run that was kept here while its server was unreachable
CONTINUES = "hlp.continues"


@dataclass(frozen=True)
class MlflowSettings(Settings):
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
        str, Doc("database of the runs whose server is unreachable; `hlp upload` sends them")
    ] = "sqlite:///work/unsent/mlflow.db"


@dataclass(frozen=True)
class ChildRun:
    """One run of a sweep: its name, its parent's run id, and the values of the swept keys.

    `place` tells it from the others of that parent; empty: the name does.
    """

    name: str
    parent: str
    swept: Mapping[str, str]
    place: str = ""

    @property
    def tags(self) -> dict[str, str]:
        """The tags by which MLflow knows it."""
        return {PARENT: self.parent, _PLACE: self.place or self.name}


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
    settings: MlflowSettings,
    run_name: str,
    config: Mapping[str, Any],
    tags: Mapping[str, str] | None = None,
    resume: str | None = None,
    *,
    params: Mapping[str, str] | None = None,
    page: Mapping[str, str] | None = None,
) -> Iterator[MlflowRun]:
    """Open an MLflow run; it ends FINISHED, KILLED if interrupted, or FAILED with a traceback.

    `config` is the whole configuration, which becomes an artifact; `params` are the parameters,
    those that somebody has chosen. `tags` may hold the `REVISION` of the code, `page` the
    `experiment_tags` of a new experiment. Name and parent are those of `as_child_run` inside of it;
    the same child of the same parent is continued. `resume` continues the run of that id, or opens
    a new one if MLflow no longer has it. A local database is created on first use, with the folder
    for artifacts beside it. Runs that a dead process has left open are closed as KILLED. If a
    server is unreachable, the run is kept in `settings.unsent`, with a warning.

    Raises ConfigError if MLflow cannot be used at `settings.uri`, DataError if it fails later.
    """
    if settings.name == "none":
        yield MlflowRun(None)
        return
    with _errors_named(settings.uri):
        child = _CHILD.get()
        page = experiment_tags(settings.about) if page is None else page
        run, logged = _opened(settings, run_name, tags or {}, page, resume)
        try:
            chosen = {**(child.swept if child else {}), **(params or {})}
            # MLflow lets no parameter be changed.
            run.log_params({k: v for k, v in chosen.items() if metric_name(k) not in logged})
            run.send(lambda client, run_id: client.log_dict(run_id, dict(config), "config.yaml"))
            yield run
            run.send(lambda client, run_id: client.set_terminated(run_id, "FINISHED"))
        except BaseException as error:
            _close(run, error)
            raise


def _opened(
    settings: MlflowSettings,
    name: str,
    tags: Mapping[str, str],
    page: Mapping[str, str],
    resume: str | None,
) -> tuple[MlflowRun, Mapping[str, str]]:
    """A run at its server or aside, and the parameters that it has if it goes on."""
    uri, child = settings.uri, _CHILD.get()
    name = name if child is None else child.name
    tags = {**tags, **(child.tags if child else {})}

    def place(at: str, more: Mapping[str, str]) -> tuple[LoggedAs, Mapping[str, str]]:
        client, experiment = open_experiment(at, settings.experiment, page)
        known = resume if child is None else _same_child(client, experiment, child)
        is_aside = CONTINUES in more  # it is sent to the run at the server: a run of its own
        logged = None if known is None or is_aside else _reopen(client, known)
        if known is None or logged is None:
            own = {"mlflow.source.name": "hlp run", **owner_tags(), **tags, **more}
            known = str(client.create_run(experiment, run_name=name, tags=own).info.run_id)
        return LoggedAs(client, experiment, known), logged or {}

    try:
        placed, logged = place(uri, {})
    except Exception as error:
        if not is_unreachable(error):
            raise
        logging.getLogger(__name__).warning(
            "MLflow's server %s is unreachable: the run is kept in %s; `hlp upload` sends it",
            uri,
            database_path(settings.unsent),
        )
        placed, logged = place(settings.unsent, {SEND_TO: uri})
        return MlflowRun(placed), logged
    if is_local(uri):
        return MlflowRun(placed), logged
    aside = {SEND_TO: uri, CONTINUES: placed.run_id}
    return MlflowRun(placed, lambda: place(settings.unsent, aside)[0]), logged


@contextmanager
def _errors_named(uri: str) -> Iterator[None]:
    """Raise MLflow's errors in the block as DataError, in one line."""
    import_client()
    from mlflow.exceptions import MlflowException

    try:
        yield
    except MlflowException as error:
        raise DataError(f"MLflow at {uri} failed: {reason(error)}") from error


def _close(run: MlflowRun, error: BaseException) -> None:
    """End a run that failed, or was killed by Ctrl-C. If MLflow fails too, only the log says so."""
    failed = isinstance(error, Exception)
    try:
        if failed:
            words, trace = f"{type(error).__name__}: {error}"[:500], traceback.format_exc()
            run.send(lambda client, run_id: client.set_tag(run_id, "error", words))
            run.send(lambda client, run_id: client.log_text(run_id, trace, "traceback.txt"))
        status = "FAILED" if failed else "KILLED"
        run.send(lambda client, run_id: client.set_terminated(run_id, status))
    except Exception as second:
        if not failed and not is_expected(second):
            raise
        logging.getLogger(__name__).warning("cannot report to MLflow: %s", reason(second))


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


def _same_child(client: "MlflowClient", experiment_id: str, child: ChildRun) -> str | None:
    """The id of this run of the sweep, if it was begun before."""
    for run in client.search_runs([experiment_id], f"tags.`{PARENT}` = '{child.parent}'"):
        if run.data.tags.get(_PLACE) == child.tags[_PLACE]:
            return str(run.info.run_id)
    return None
