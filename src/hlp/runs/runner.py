"""A run from start to end: learn, find, score, draw, log. Outputs on disk are reused."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hlp.config.build import Run
from hlp.data.dataset import CheckedFrames
from hlp.evaluation.average_precision import average_precision
from hlp.evaluation.evaluator import score_targets
from hlp.evaluation.summary import count_false_alarms, scores_in_vain, summarise
from hlp.evaluation.waterfall import BAD_FRAME, vote_quality
from hlp.files import MANIFEST, PAGE, POSES, SCORES, SUMMARY, TIMES, write_json
from hlp.method.find.trace import Trace
from hlp.progress import Progress
from hlp.records import PoseEstimate, TargetScore, frame_key, parse_frame_key
from hlp.refinement.score_model import MIN_SCORE
from hlp.reporting.experiments import write_reports
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import stacked_bars
from hlp.reporting.figures.charts import calibration_figure
from hlp.reporting.mlflow.pages import summary_metrics
from hlp.reporting.mlflow.run import MlflowRun
from hlp.reporting.page import page_or_log, write_run_page
from hlp.reporting.page.report_data import PANELS, STAGES
from hlp.reporting.paper_reports import TABLES
from hlp.reporting.summary_tables import format_summary, run_verdict
from hlp.results.poses_file import read_poses, write_poses, write_scores
from hlp.runs.diagnosis import FrameNotes, explain_misses, note_frame
from hlp.runs.manifest import make_manifest, poses_digest
from hlp.runs.mlflow_log import begun, log_pictures, log_training, say_where
from hlp.runs.pictures import draw_pictures
from hlp.runs.timing import Timing, measure_times
from hlp.stages.detection import DetectionStages, OnBadFrame
from hlp.stages.frame_task import render_in_workers
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages

_NO_TRUTH = "Poses are found, not scored: the data set states no true poses."
_logger = logging.getLogger(__name__)


def run_method(run: Run, output: Path) -> dict[str, Any]:
    """Run every stage that is not on disk, write the results into `output`, return the summary.

    `output` receives summary.json, scores.csv, poses.csv, panels/, stages/, report/, manifest.json
    and report.html; experiments of the paper's tables also the table. Where true poses are private:
    only poses.csv, timing.json and manifest.json; the summary is empty. Everything is logged as one
    MLflow run, opened first, so a crash leaves it FAILED. Raises DataError if no frame can be used;
    with `on_bad_frame` "report", single ones count as missed.
    """
    settings = run.settings
    with begun(run, output) as (store, tracker):
        for key, reason in run.bad_frames.items():
            _logger.warning("frame %s cannot be used: %s", key, reason)
        detection = stages_of(run, store, settings.on_bad_frame)
        render_in_workers(detection.training, settings.executor)
        estimates, notes = _find(run, detection)
        trained = log_training(detection.training, tracker)
        run.require_some(detection.failed)
        timing = measure_times(run, detection, estimates)
        write_poses(output / POSES, estimates)
        summary, verdict, said = {}, _NO_TRUTH, f"\n{_NO_TRUTH} They are in {output / POSES}"
        if any(noted.truth.targets for noted in notes):
            summary = _score(run, detection, estimates, notes, timing, output)
            verdict, said = run_verdict(summary), format_summary(summary)
            tracker.log_metrics(summary_metrics(summary))
        else:
            write_json(output / TIMES, timing.summary())
        digest = {"poses": poses_digest(output / POSES)}
        write_json(output / MANIFEST, make_manifest(run, store) | digest)
        if settings.name in TABLES:
            write_reports(output)
        if summary:
            page_or_log(write_run_page, output)
            log_pictures(output, tracker)
        tracker.describe("\n\n".join([verdict, *trained]))
        tracker.log_artifacts(output)
    print(said)
    say_failed(detection.failed if summary else {}, len(run.keys))
    _say_where(run, output, tracker)
    return summary


def _find(run: Run, detection: DetectionStages) -> tuple[list[PoseEstimate], list[FrameNotes]]:
    """Find the objects in all frames; what scoring needs of each frame, in order."""
    notes: dict[str, FrameNotes] = {}

    def look(key: str, found: Trace) -> None:
        notes[key] = note_frame(run.dataset, detection.load(key), found, run.settings.evaluation)

    estimates = detection.estimates(look)
    return estimates, [notes[key] for key in run.keys if key not in detection.failed]


def _search_empty(run: Run, detection: DetectionStages) -> list[float]:
    """Look for every object where none is; the best score of each in each frame."""
    dataset = run.dataset.in_empty_frames()
    if dataset is None:
        return []
    keys, settings = dataset.frames.keys, run.settings
    _logger.info("%d frames that show none of the objects are searched", len(keys))
    of = dataset, settings.method, detection.training, keys
    return scores_in_vain([], DetectionStages(*of, on_bad_frame=settings.on_bad_frame).estimates())


def _score(
    run: Run,
    detection: DetectionStages,
    estimates: Sequence[PoseEstimate],
    notes: Sequence[FrameNotes],
    timing: Timing,
    output: Path,
) -> dict[str, Any]:
    """Score the poses as read from poses.csv; write and draw what comes of it."""
    dataset, settings = run.dataset, run.settings
    saved = read_poses(output / POSES)
    truths = [noted.truth for noted in notes]
    shown, meshes = Progress(truths, desc="scoring", unit="frame"), dataset.evaluation_meshes
    of = dataset.models, saved, settings.evaluation, meshes, dataset.vsd_delta
    scores = score_targets(shown, *of)
    scores = explain_misses(detection, notes, scores, settings.evaluation)
    scores = with_failed_frames(run, detection.failed, scores)
    write_scores(output / SCORES, scores, dataset.names)
    draw_pictures(run, detection, saved, scores, output)
    votes = vote_quality([counts for noted in notes for counts in noted.votes], dataset.names)
    given = timing.milliseconds(), votes, settings.evaluation, settings.seed
    summary = summarise(scores, dataset.names, *given)
    summary |= {"timing": timing.summary(), "frames": len(run.keys)}
    if dataset.search_all:
        summary["detection"] = average_precision(truths, dataset.models, saved, meshes)
    in_vain = [*_search_empty(run, detection), *scores_in_vain(truths, estimates)]
    summary["false_alarms"] = count_false_alarms(in_vain, MIN_SCORE)
    summary["frames_failed"] = describe_failed(detection.failed)
    write_json(output / SUMMARY, summary)
    save_figure(stacked_bars(summary["waterfall"]), output / "waterfall")
    if summary["calibration"]["answers"]:
        save_figure(calibration_figure(summary["calibration"]), output / "calibration")
    return summary


def _say_where(run: Run, output: Path, tracker: MlflowRun) -> None:
    say = _logger.info
    files = SUMMARY, SCORES, POSES, TIMES, MANIFEST
    names = [name for name in files if (output / name).is_file()]
    say("\nResults   %s (%s)", output, ", ".join(names))
    if (output / PAGE).is_file():
        say("Report    %s (open it in a browser)", output / PAGE)
    if run.settings.panels > 0:
        say("Pictures  %s, %s (what each stage saw)", output / PANELS, output / STAGES)
    say_where(run, tracker)


def stages_of(run: Run, store: StageStore, on_bad_frame: OnBadFrame = "fail") -> DetectionStages:
    """Training and detection stages over the run's frames; nothing is computed yet.

    `on_bad_frame` "report" is for those who count the targets of bad frames as wrong. Raises
    DataError for the first frame that is known to be bad, with "fail".
    """
    if on_bad_frame == "fail":
        run.require_sound_frames()
    settings = run.settings
    training = TrainingStages(run.dataset, settings.method, store, settings.warm_start)
    of = run.dataset, settings.method, training, run.keys, settings.executor
    return DetectionStages(*of, on_bad_frame, run.bad_frames)


def with_failed_frames(
    run: Run, failed: Mapping[str, str], scores: Sequence[TargetScore]
) -> list[TargetScore]:
    """The scores and those of the frames that failed, in the order of the run's frames."""
    if not failed:
        return list(scores)
    source = run.dataset.frames
    assert isinstance(source, CheckedFrames)  # of others, a bad frame ends the run
    lost = [
        TargetScore(
            *parse_frame_key(key),
            object_id,
            found=False,
            visible_fraction=visible_fraction,
            mssd_recall=0.0,
            mspd_recall=0.0,
            vsd_recall=0.0,
            cause=BAD_FRAME,
        )
        for key in failed
        for object_id, visible_fraction in source.stated_targets(key)
    ]
    place = {key: number for number, key in enumerate(run.keys)}
    return sorted([*scores, *lost], key=lambda s: place[frame_key(s.scene_id, s.frame_id)])


def describe_failed(failed: Mapping[str, str]) -> list[dict[str, object]]:
    """`frames_failed` of `summary.json`: the frames and the reasons."""
    frames = ((*parse_frame_key(key), reason) for key, reason in sorted(failed.items()))
    return [{"scene_id": scene, "im_id": image, "reason": why} for scene, image, why in frames]


def say_failed(failed: Mapping[str, str], frames: int) -> None:
    """What a run says of them at its end; nothing if there is none."""
    if failed:
        said = f"\n{len(failed)} of {frames} frames could not be used; their targets count as wrong"
        _logger.warning("%s (the reasons are in summary.json)", said)
