"""Runs that were kept here while MLflow's server was unreachable: send them, with all they hold."""

import logging
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.errors import MissingFileError, NetworkError
from hlp.reporting.local_database import SQLITE, owner_is_dead, remove_database
from hlp.reporting.mlflow_client import database_path, follow_database, import_client, is_away
from hlp.reporting.tracker import METRICS_AT_ONCE, PARAMETERS_AT_ONCE
from hlp.reporting.tracking import CONTINUES, PARENT, SEND_TO

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Run

_SENT_AS = "hlp.sent_as"
_SENT_FROM = "hlp.sent_from"  # there: its id here, by which a call that was killed is continued
_OWN = {SEND_TO, CONTINUES, _SENT_AS, PARENT}
_BY_MLFLOW = ("mlflow.user", "mlflow.loggedImages")  # other tags of MLflow's are sent


def send_runs(unsent: str, uri: str | None = None) -> list[str]:
    """Send all ended runs of the database `unsent` to their servers, or to `uri`; their names.

    What is sent is not sent again; when the database holds nothing else, it is deleted with its
    artifacts. Raises MissingFileError if there is none, NetworkError if a server is still away.
    """
    database = database_path(unsent)
    if not database.is_file():
        raise MissingFileError(f"nothing is waiting: there is no {database}")
    follow_database(database)
    kept = import_client()(f"{SQLITE}{database}")
    experiments = {each.experiment_id: each for each in kept.search_experiments()}
    runs = kept.search_runs(list(experiments), order_by=["attributes.start_time ASC"])
    kept_here = [run for run in runs if SEND_TO in run.data.tags]
    waiting = [run for run in kept_here if _SENT_AS not in run.data.tags]
    ended = [run for run in waiting if run.info.status != "RUNNING" or owner_is_dead(run.data.tags)]
    sent = {r.info.run_id: r.data.tags[_SENT_AS] for r in runs if _SENT_AS in r.data.tags}
    for run in ended:
        target = import_client()(uri or run.data.tags[SEND_TO])
        try:
            sent[run.info.run_id] = _send(kept, run, experiments, target, sent)
        except Exception as error:
            if not is_away(error):
                raise
            raise NetworkError(f"MLflow's server is still away: {error}".split("\n")[0]) from error
        kept.set_tag(run.info.run_id, _SENT_AS, sent[run.info.run_id])
    if len(ended) < len(waiting):
        logging.getLogger(__name__).info("%d still run", len(waiting) - len(ended))
    elif len(kept_here) == len(runs):
        remove_database(database)
    return [str(run.info.run_name) for run in ended]


def _send(
    kept: "MlflowClient",
    run: "Run",
    experiments: Mapping[str, Any],
    target: "MlflowClient",
    sent: Mapping[str, str],
) -> str:
    """Send one run; its id there."""
    tags = {
        name: value
        for name, value in run.data.tags.items()
        if name not in _OWN and name not in _BY_MLFLOW
    }
    parent = run.data.tags.get(PARENT)
    if parent is not None:
        tags[PARENT] = sent.get(parent, parent)
    experiment = experiments[run.info.experiment_id]
    there = _experiment(target, experiment.name, experiment.tags)
    run_id = run.data.tags.get(CONTINUES)
    if run_id is None:
        begun = target.search_runs([there], f"tags.`{_SENT_FROM}` = '{run.info.run_id}'")
        tags[_SENT_FROM] = run.info.run_id
        created = begun or [target.create_run(there, run.info.start_time, tags, run.info.run_name)]
        run_id = str(created[0].info.run_id)
    else:
        for name, value in tags.items():
            target.set_tag(run_id, name, value)
    _send_values(kept, run, target, run_id)
    with tempfile.TemporaryDirectory() as folder:
        for path in kept.list_artifacts(run.info.run_id):
            kept.download_artifacts(run.info.run_id, path.path, folder)
        target.log_artifacts(run_id, folder)
    status = "KILLED" if run.info.status == "RUNNING" else run.info.status
    target.set_terminated(run_id, status, run.info.end_time)
    for child in target.search_runs([there], f"tags.`{PARENT}` = '{run.info.run_id}'"):
        target.set_tag(child.info.run_id, PARENT, run_id)  # it reached the server before this one
    return run_id


def _send_values(kept: "MlflowClient", run: "Run", target: "MlflowClient", run_id: str) -> None:
    """Parameters, data sets, and metrics with all their steps."""
    from mlflow.entities import Param

    known = target.get_run(run_id).data.params
    params = [Param(name, value) for name, value in run.data.params.items() if name not in known]
    for start in range(0, len(params), PARAMETERS_AT_ONCE):
        target.log_batch(run_id, params=params[start : start + PARAMETERS_AT_ONCE])
    metrics = [
        each for name in run.data.metrics for each in kept.get_metric_history(run.info.run_id, name)
    ]
    for start in range(0, len(metrics), METRICS_AT_ONCE):
        target.log_batch(run_id, metrics=metrics[start : start + METRICS_AT_ONCE])
    if run.inputs is not None and run.inputs.dataset_inputs:
        target.log_inputs(run_id, datasets=run.inputs.dataset_inputs)


def _experiment(target: "MlflowClient", name: str, tags: Mapping[str, str]) -> str:
    found = target.get_experiment_by_name(name)
    if found is not None:
        return str(found.experiment_id)
    return str(target.create_experiment(name, tags=dict(tags)))


def unsent_database(work: Path) -> str:
    """Where `hlp run` keeps runs of a folder `work` while the server is away."""
    return f"{SQLITE}{work / 'unsent' / 'mlflow.db'}"
