"""A run from start to end: learn, find, score, draw, log. What is on disk is not made again."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.evaluation.nearness import votes_quality
from hlp.evaluation.poses_file import read_poses, write_poses, write_scores
from hlp.evaluation.summary import summarise
from hlp.pipeline import manifest
from hlp.pipeline.build import Run
from hlp.pipeline.diagnosis import explain_misses, tally_votes
from hlp.pipeline.drawing import picture_of_stages
from hlp.pipeline.finding import Finder
from hlp.pipeline.learning import Learner
from hlp.pipeline.store import StageStore
from hlp.pipeline.threads import set_threads
from hlp.pipeline.tracked import log_inputs, log_tables, revision_tag, run_name
from hlp.pipeline.training import read_history
from hlp.pipeline.view_work import render_in_workers
from hlp.records import PoseEstimate
from hlp.reporting.metrics import summary_metrics
from hlp.reporting.panels import write_png
from hlp.reporting.tables import format_summary
from hlp.reporting.tracking import Tracker, how_to_browse, track_run
from hlp.reporting.waterfall_bars import draw_waterfall

STAGES = ("holistic", "local", "voting", "refinement")


def run(planned: Run, output: Path) -> dict[str, Any]:
    """Run every stage not yet on disk, write the results into `output`, return the summary.

    `output` receives summary.json, scores.csv, poses.csv, panels/ and, last, manifest.json.
    Everything is logged as one MLflow run, which is opened first: a crash leaves it FAILED.
    """
    settings = planned.settings
    if not planned.world.annotated:
        raise ValueError("these frames have no true poses to score against: use `hlp predict`")
    set_threads(settings)
    output.mkdir(parents=True, exist_ok=True)
    (output / manifest.FILE).unlink(missing_ok=True)
    name = run_name(settings, output)
    with track_run(settings.reporting, name, planned.config, revision_tag()) as tracker:
        log_inputs(planned, tracker)
        store = StageStore(Path(settings.work))
        learner = Learner(planned.world, settings, store)
        render_in_workers(learner)
        finder = Finder(planned.world, settings, learner, store, planned.keys)
        estimates = finder.estimates()
        _log_training(learner, tracker)
        summary = _score(planned, finder, estimates, output)
        _draw(planned, finder, estimates, output / "panels")
        tracker.log_metrics(summary_metrics(summary))
        log_tables(summary, output, tracker)
        made = manifest.make_manifest(planned, store)
        made["poses"] = manifest.poses_digest(output / "poses.csv")
        manifest.write_json(output / manifest.FILE, made)
        tracker.log_artifacts(output)
    print(format_summary(summary))
    _say_where(planned, output, tracker)
    return summary


def _score(
    planned: Run, finder: Finder, estimates: Sequence[PoseEstimate], output: Path
) -> dict[str, Any]:
    """Save the poses first, then score what was saved."""
    world, settings = planned.world, planned.settings
    answered = [each for each in estimates if each.pose_cam_obj is not None]
    write_poses(output / "poses.csv", answered)
    keys = tqdm(planned.keys, desc="scores", unit="frame", disable=None)
    truths, tallies = [], []
    for key in keys:
        frame = world.frames.load(key)
        truths.append(FrameTruth.of(frame))
        tallies += tally_votes(finder, frame)
    saved = read_poses(output / "poses.csv")
    scores = score_targets(truths, world.models, saved, settings.evaluation)
    scores = explain_misses(finder, scores)
    names = {object_id: model.name for object_id, model in world.models.items()}
    write_scores(output / "scores.csv", scores, names)
    summary = summarise(
        scores,
        names,
        _times_ms(estimates),
        votes_quality(tallies, names),
        settings.evaluation,
        settings.seed,
    )
    manifest.write_json(output / "summary.json", summary)
    draw_waterfall(output, summary["waterfall"])
    return summary


def _times_ms(estimates: Sequence[PoseEstimate]) -> dict[str, list[float]]:
    """Milliseconds of one object in one frame, in all and for each stage."""
    total = [1000.0 * sum(each.seconds.values()) for each in estimates]
    stages = {name: [1000.0 * each.seconds[name] for each in estimates] for name in STAGES}
    return {"total": total, **stages}


def _log_training(learner: Learner, tracker: Tracker) -> None:
    for stage, output in (("classifier", learner.classifier()), ("encoder", learner.encoder())):
        for epoch, row in enumerate(read_history(output.folder)):
            metrics = {name: value for name, value in row.items() if name != "epoch"}
            tracker.log_epoch_metrics(stage, epoch, metrics)


def _draw(planned: Run, finder: Finder, estimates: Sequence[PoseEstimate], folder: Path) -> None:
    """The paper's four panels (Fig. 7) for a handful of frames, each of another object in turn."""
    world = planned.world
    answers = {(each.scene_id, each.frame_id, each.object_id): each for each in estimates}
    count = min(planned.settings.panels, len(planned.keys))
    for i in range(count):
        frame = world.frames.load(planned.keys[i * len(planned.keys) // count])
        if not frame.targets:
            continue
        target = frame.targets[i % len(frame.targets)]
        answer = answers.get((frame.scene_id, frame.frame_id, target.object_id))
        picture = picture_of_stages(finder, frame, target.object_id, answer, target)
        name = world.models[target.object_id].name
        folder.mkdir(parents=True, exist_ok=True)
        write_png(folder / f"{frame.key}_{name}.png", picture)


def _say_where(planned: Run, output: Path, tracker: Tracker) -> None:
    say = logging.getLogger(__name__).info
    say("\nResults   %s (summary.json, scores.csv, poses.csv, manifest.json)", output)
    if planned.settings.panels > 0:
        say("Pictures  %s (what each stage saw)", output / "panels")
    browse = how_to_browse(planned.settings.reporting, tracker)
    say("MLflow    %s", browse.replace("\n", "\n          "))
