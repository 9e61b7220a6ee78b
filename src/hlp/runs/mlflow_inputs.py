"""What a run logs to MLflow besides its files: name, revision, data sets, tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.data.dataset import frames_identity
from hlp.files import SCORES, read_csv
from hlp.reporting.mlflow_metrics import MLFLOW_METRICS
from hlp.reporting.tracking import REVISION, Tracker
from hlp.results.scores_file import SCORE_COLUMNS
from hlp.stages.provenance import git_revision

if TYPE_CHECKING:
    from hlp.config.build import Run
    from hlp.config.settings import RunSettings


def run_name(settings: "RunSettings", output: Path) -> str:
    """A name for people: experiment, encoder, voting and output folder."""
    return f"{settings.name} {settings.encoder.name} {settings.voting.name} {output.name}"


def revision_tag() -> dict[str, str]:
    """The commit under the name by which MLflow shows it; empty if there is none."""
    revision = git_revision()
    return {} if revision is None else {REVISION: revision}


def log_inputs(run: "Run", tracker: Tracker) -> None:
    """Log the data sets that the run reads, each with a hash of its content."""
    dataset, data = run.dataset, run.config["data"]
    where = str(data.get("root", data["name"]))
    tracker.log_input(f"{data['name']} frames", dataset.frames_identity, where, "evaluation")
    for object_id in dataset.target_ids:
        name, digest = dataset.models[object_id].name, dataset.model_identities[object_id]
        tracker.log_input(f"model of {name}", digest, where, "objects")
    photographs = str(dataset.photographs or "procedural")
    tracker.log_input("photographs", dataset.photographs_identity, photographs, "training")
    if dataset.background_frames is not None:
        digest = frames_identity(dataset.background_frames)
        tracker.log_input("background frames", digest, where, "training")


def log_tables(summary: Mapping[str, Any], output: Path, tracker: Tracker) -> None:
    """Log recalls per object and the scores of every target, as tables on MLflow's page."""
    objects = summary["per_object"]
    columns: dict[str, list[Any]] = {
        "object": list(objects),
        "targets": [scores["targets"] for scores in objects.values()],
    }
    for key, shown in MLFLOW_METRICS.items():
        columns[shown] = [scores[key]["recall"] for scores in objects.values()]
    tracker.log_table("tables/objects", columns)
    rows = read_csv(output / SCORES, SCORE_COLUMNS)
    tracker.log_table(
        "tables/targets", {name: [row[name] for row in rows] for name in SCORE_COLUMNS}
    )
