"""Runs that were kept here while MLflow's server was unreachable: send them, with all they hold."""

import logging
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.errors import MissingFileError, NetworkError
from hlp.reporting.mlflow import (
    SQLITE,
    database_path,
    import_client,
    is_unreachable,
    owner_is_dead,
    prepare_database,
    remove_database,
)
from hlp.reporting.mlflow.pages import NOTE, run_path
from hlp.reporting.mlflow.run import LoggedAs, MlflowRun
from hlp.reporting.mlflow.tracking import CONTINUES, PARENT, SEND_TO

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Run

_SENT_AS = "hlp.sent_as"
_SENT_FROM = "hlp.sent_from"  # there: its id here, by which a call that was killed is continued
_NOT_SENT = (SEND_TO, CONTINUES, _SENT_AS, PARENT, "mlflow.user", "mlflow.loggedImages")  # tags


def unsent_database(work: Path) -> str:
    """Where `hlp run` keeps runs of a folder `work` while the server is unreachable."""
    return f"{SQLITE}{work / 'unsent' / 'mlflow.db'}"


def send_runs(unsent: str, uri: str | None = None) -> list[str]:
    """Send all ended runs of the database `unsent` to their servers, or to `uri`; their names.

    What is sent is not sent again; when the database holds nothing else, it is deleted with its
    artifacts. Raises MissingFileError if there is none, NetworkError if a server is still away.
    """
    database = database_path(unsent)
    if not database.is_file():
        raise MissingFileError(f"nothing to send: there is no {database}")
    prepare_database(database)
    kept = import_client()(f"{SQLITE}{database}")
    experiments = {found.experiment_id: found for found in kept.search_experiments()}
    runs = kept.search_runs(list(experiments), order_by=["attributes.start_time ASC"])
    kept_here = [run for run in runs if SEND_TO in run.data.tags]
    waiting = [run for run in kept_here if _SENT_AS not in run.data.tags]
    ended = [run for run in waiting if run.info.status != "RUNNING" or owner_is_dead(run.data.tags)]
    sent = {r.info.run_id: r.data.tags[_SENT_AS] for r in runs if _SENT_AS in r.data.tags}
    for run in ended:
        target = import_client()(uri or run.data.tags[SEND_TO])
        try:
            experiment = experiments[run.info.experiment_id]
            sent[run.info.run_id] = _send(kept, run, experiment, target, sent)
        except Exception as error:
            if not is_unreachable(error):
                raise
            raise NetworkError(f"MLflow's server is still away: {error}".split("\n")[0]) from error
        kept.set_tag(run.info.run_id, _SENT_AS, sent[run.info.run_id])
    if len(ended) < len(waiting):
        logging.getLogger(__name__).info("%d are still running", len(waiting) - len(ended))
    elif len(kept_here) == len(runs):
        remove_database(database)
    return [str(run.info.run_name) for run in ended]


def _send(
    kept: "MlflowClient",
    run: "Run",
    experiment: Any,
    target: "MlflowClient",
    sent: Mapping[str, str],
) -> str:
    """Send one run; its id there."""
    info, tags = run.info, {k: v for k, v in run.data.tags.items() if k not in _NOT_SENT}
    parent = run.data.tags.get(PARENT)
    if parent is not None:
        tags[PARENT] = sent.get(parent, parent)
    known = target.get_experiment_by_name(experiment.name)
    there = str(
        target.create_experiment(experiment.name, tags=experiment.tags)
        if known is None
        else known.experiment_id
    )
    run_id = run.data.tags.get(CONTINUES)
    if run_id is None:
        begun = target.search_runs([there], f"tags.`{_SENT_FROM}` = '{info.run_id}'")
        tags[_SENT_FROM] = info.run_id
        created = begun or [target.create_run(there, info.start_time, tags, info.run_name)]
        run_id = str(created[0].info.run_id)
    else:
        for name, value in tags.items():
            target.set_tag(run_id, name, value)
    if NOTE in tags:
        linked = run_path(info.experiment_id, info.run_id)[1:]  # by the description: its own page
        target.set_tag(run_id, NOTE, tags[NOTE].replace(linked, run_path(there, run_id)[1:]))
    _send_values(kept, run, MlflowRun(LoggedAs(target, there, run_id)))
    with tempfile.TemporaryDirectory() as folder:
        for path in kept.list_artifacts(info.run_id):
            kept.download_artifacts(info.run_id, path.path, folder)
        target.log_artifacts(run_id, folder)
    status = "KILLED" if info.status == "RUNNING" else info.status
    target.set_terminated(run_id, status, info.end_time)
    for child in target.search_runs([there], f"tags.`{PARENT}` = '{info.run_id}'"):
        target.set_tag(child.info.run_id, PARENT, run_id)  # it reached the server before this one
    return run_id


def _send_values(kept: "MlflowClient", run: "Run", target: MlflowRun) -> None:
    """Parameters, data sets, and metrics with all their steps."""
    known = target.send(lambda client, run_id: client.get_run(run_id).data.params) or {}
    params = run.data.params.items()
    target.log_entities("params", ((name, value) for name, value in params if name not in known))
    histories = (kept.get_metric_history(run.info.run_id, name) for name in run.data.metrics)
    metrics = (metric for history in histories for metric in history)
    target.log_entities("metrics", ((m.key, m.value, m.timestamp, m.step) for m in metrics))
    inputs = run.inputs.dataset_inputs if run.inputs is not None else []
    if inputs:
        target.send(lambda client, run_id: client.log_inputs(run_id, datasets=inputs))
