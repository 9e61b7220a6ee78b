"""What a run logs to MLflow besides its files: name, tags, data sets, pictures."""

import logging
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.files import MANIFEST, SCORES, remove_unfinished
from hlp.method.find.search import MOST_INSTANCES
from hlp.method.learn.learnt_folder import LearntFolder
from hlp.method.learn.model_files import read_history
from hlp.method.pyfunc_model import IMAGES, example_image
from hlp.refinement.score_model import MIN_SCORE
from hlp.reporting.comparison import read_targets
from hlp.reporting.mlflow.pages import experiment_tags, how_to_browse, short_name
from hlp.reporting.mlflow.registry import register
from hlp.reporting.mlflow.run import MlflowRun
from hlp.reporting.mlflow.tracking import REVISION, track_run
from hlp.reporting.page.report_data import FOLDER, PANELS, ReportData, drawn_stages
from hlp.stages.manifest import git_revision
from hlp.stages.store import StageStore
from hlp.threads import set_compute_threads

if TYPE_CHECKING:
    from hlp.config.build import Run
    from hlp.stages.training import TrainingStages

MOST_MISSES = 12
"""Missed targets whose pictures are logged; the report shows more."""
_PICTURES = "1. Pictures"  # MLflow sorts the groups on a run's page by name
_UNTAGGED = ("experiment", "reporting", "machine", "executor")  # groups that no result depends on


@contextmanager
def begun(
    run: "Run", output: Path, resume: str | None = None
) -> Iterator[tuple[StageStore, MlflowRun]]:
    """The store and the MLflow run of a run whose results go into `output`; see `track_run`.

    Its threads are set, and a manifest of an earlier result is removed.
    """
    settings, chosen = run.settings, run.chosen
    set_compute_threads(settings.machine.threads)
    output.mkdir(parents=True, exist_ok=True)
    remove_unfinished(output)  # or MLflow would get it
    (output / MANIFEST).unlink(missing_ok=True)
    name = short_name(chosen.overrides, chosen.groups, settings.name)
    data = str(run.config["data"]["name"])
    page = experiment_tags(settings.reporting.about, chosen.command, data)
    opened = settings.reporting, name, run.config, run_tags(chosen.groups, output), resume
    with track_run(*opened, params=chosen.overrides, page=page) as tracker:
        if chosen.command:
            tracker.set_tags({"command": chosen.command})
        with tracker.system_metrics():
            _log_inputs(run, tracker)
            yield StageStore(Path(settings.work)), tracker


def run_tags(groups: Mapping[str, str], output: Path) -> dict[str, str]:
    """What a run is of (the alternative of each group, e.g. `refinement: icp`) and where it is."""
    tags = {group: name for group, name in groups.items() if group not in _UNTAGGED}
    machine = f"{platform.node()}, {os.cpu_count()} cores, {platform.system()}"
    tags |= {"machine": machine, "output": str(output.absolute())}
    revision = git_revision()
    return tags if revision is None else {**tags, REVISION: revision}


def _log_inputs(run: "Run", tracker: MlflowRun) -> None:
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
        digest = dataset.background_frames.identity()
        tracker.log_input("background frames", digest, where, "training")


def log_training(training: "TrainingStages", tracker: MlflowRun) -> list[str]:
    """Log the losses, and say which earlier runs have trained what this one has reused."""
    said = []
    for stage, output in (("classifier", training.classifier()), ("encoder", training.encoder())):
        history = read_history(output.folder)
        rows = [{name: row[name] for name in row if name != "epoch"} for row in history]
        said.append(tracker.log_training(stage, output.fingerprint, rows))
    return [words for words in said if words]


def log_pictures(output: Path, tracker: MlflowRun) -> None:
    """Log poses and panels, a step for each frame; missed targets by cause; those of stages.

    The frame's number is the step, so equal steps of two runs show the same frame.
    """
    for path in sorted((output / PANELS).glob("*.jpg")):
        scene, frame, drawn = path.stem.split("_", 2)
        what = "poses" if drawn == "poses" else "panels"
        tracker.log_image(path, f"{_PICTURES}/{what} in scene {int(scene)}", int(frame))
    for path in drawn_stages(output).values():
        tracker.log_image(path, f"{_PICTURES}/stages - {path.stem.replace('_', ' ')}", 0)
    scores = read_targets(output / SCORES)
    shown = ReportData.read(output).scenes
    missed = [key for key in sorted(shown) if key in scores and not scores[key].correct("add")]
    steps: dict[str, int] = {}
    for key in missed[:: max(1, -(-len(missed) // MOST_MISSES))]:
        cause = (scores[key].score.cause or "unknown").replace("_", " ")
        steps[cause] = steps.get(cause, -1) + 1
        picture = output / FOLDER / shown[key].picture
        tracker.log_image(picture, f"{_PICTURES}/missed - {cause}", steps[cause])


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
    images = {key: getattr(image, key)[None] for key in IMAGES}
    objects = tuple(learnt.record.objects)
    options = {"objects": objects, "max_instances": MOST_INSTANCES, "min_score": MIN_SCORE}
    return register(folder, model, uri, options, images)
