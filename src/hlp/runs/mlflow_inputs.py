"""What a run logs to MLflow besides its files: name, tags, data sets, tables."""

import logging
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hlp.data.dataset import frames_identity
from hlp.files import SCORES, read_csv
from hlp.method.detector import MOST_INSTANCES
from hlp.method.learn.learnt_folder import LearntFolder
from hlp.method.pyfunc_model import example_image
from hlp.refinement.score_model import MIN_SCORE
from hlp.reporting.mlflow_pages import HEADLINES, experiment_tags, how_to_browse, short_name
from hlp.reporting.mlflow_run import MlflowRun
from hlp.reporting.mlflow_tracking import REVISION, track_run
from hlp.reporting.model_registry import register
from hlp.results.poses_file import SCORE_COLUMNS
from hlp.stages.manifest import git_revision

if TYPE_CHECKING:
    from hlp.config.build import Run

_UNTAGGED = ("experiment", "reporting", "machine", "executor")  # groups that no result depends on


@contextmanager
def tracked(run: "Run", output: Path, resume: str | None = None) -> Iterator[MlflowRun]:
    """Open the MLflow run of a run whose results go into `output`; see `track_run`."""
    settings, chosen = run.settings, run.chosen
    name = short_name(chosen.overrides, chosen.groups, settings.name)
    data = run.config["data"]
    page = experiment_tags(settings.reporting.about, chosen.command, str(data["name"]))
    with track_run(
        settings.reporting,
        name,
        run.config,
        {**choice_tags(chosen.groups), **place_tags(output)},
        resume,
        params=chosen.overrides,
        page=page,
    ) as tracker:
        if chosen.command:
            tracker.set_tags({"command": chosen.command})
        with tracker.system_metrics():
            yield tracker


def choice_tags(groups: Mapping[str, str]) -> dict[str, str]:
    """The alternative of each config group as a tag, e.g. `refinement: icp`."""
    return {group: name for group, name in groups.items() if group not in _UNTAGGED}


def place_tags(output: Path) -> dict[str, str]:
    """Where a run happens: commit, machine, folder of the results."""
    revision = git_revision()
    machine = f"{platform.node()}, {os.cpu_count()} cores, {platform.system()}"
    tags = {"machine": machine, "output": str(output.absolute())}
    return tags if revision is None else {**tags, REVISION: revision}


def log_inputs(run: "Run", tracker: MlflowRun) -> None:
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


def log_tables(summary: Mapping[str, Any], output: Path, tracker: MlflowRun) -> None:
    """Log recalls per object and the scores of every target, as tables on MLflow's page."""
    objects = summary["per_object"]
    columns: dict[str, list[Any]] = {
        "object": list(objects),
        "targets": [scores["targets"] for scores in objects.values()],
    }
    for key in HEADLINES[:3]:
        columns[key] = [scores[key]["recall"] for scores in objects.values()]
    tracker.log_table("tables/objects", columns)
    rows = read_csv(output / SCORES, SCORE_COLUMNS)
    tracker.log_table(
        "tables/targets", {name: [row[name] for row in rows] for name in SCORE_COLUMNS}
    )


def say_where(run: "Run", tracker: MlflowRun) -> None:
    """Tell a person at a terminal how to see the run in MLflow."""
    browse = how_to_browse(run.settings.reporting.uri, tracker.page_path)
    if browse:
        logging.getLogger(__name__).info("MLflow    %s", browse.replace("\n", "\n          "))


def register_learnt(folder: Path, model: str, uri: str) -> str:
    """Copy a folder of learnt objects into MLflow as a new version of `model`; its address.

    Raises what `register` raises, and DataError if the folder is damaged.
    """
    learnt = LearntFolder(folder)
    image = example_image(next(iter(learnt.models.values())))
    images = {
        "rgb": image.rgb[None],
        "depth": image.depth[None].astype(np.float32),
        "camera_matrix": image.camera_matrix[None],
    }
    objects = tuple(learnt.record.objects)
    options = {"objects": objects, "max_instances": MOST_INSTANCES, "min_score": MIN_SCORE}
    return register(folder, model, uri, options, images)
