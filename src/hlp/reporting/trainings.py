"""Loss curves in MLflow: in the run that has trained a network; later ones point to that run."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from hlp.reporting.tracker import Tracker, run_page

if TYPE_CHECKING:
    from mlflow import MlflowClient


def log_training(
    tracker: Tracker, stage: str, fingerprint: str, rows: Sequence[Mapping[str, float]]
) -> str:
    """Log the training of a stage's output by epoch, unless an earlier run has it already.

    Returns what to say in the run's description: a link to that run; empty if this is the one.
    """
    if tracker.run is None or not rows:
        return ""
    name = f"trained.{stage}"
    found = tracker.send(lambda client, _: _run_with(client, name, fingerprint))
    if found is None:
        tracker.log_curves(stage, rows)
        tracker.set_tags({name: fingerprint})
        return ""
    experiment_id, run_id, run_name = found
    if run_id == tracker.run_id:
        return ""
    tracker.set_tags({f"{stage}_of_run": run_id})
    return f"{stage} trained by [{run_name}]({run_page(experiment_id, run_id)[1:]})"


def _run_with(client: "MlflowClient", tag: str, value: str) -> tuple[str, str, str] | None:
    """Experiment, id and name of the first run with this tag."""
    experiments = [each.experiment_id for each in client.search_experiments()]
    found = client.search_runs(
        experiments,
        f"tags.`{tag}` = '{value}'",
        order_by=["attributes.start_time ASC"],
        max_results=1,
    )
    if not found:
        return None
    info = found[0].info
    return str(info.experiment_id), str(info.run_id), str(info.run_name)
