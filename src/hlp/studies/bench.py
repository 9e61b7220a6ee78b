"""Time and memory of each part of detection, and of other settings on the same frames."""

import resource
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from hlp.arrays import spread
from hlp.config.build import Run, with_changes
from hlp.config.settings import TASKS, RunSettings
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.files import write_json, write_text
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.settings import FindSettings
from hlp.progress import Progress
from hlp.records import Frame, PoseEstimate
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import bench_bars
from hlp.reporting.study_numbers import ADD
from hlp.reporting.study_tables import CONFIGURED, format_bench
from hlp.results.recalls import TargetKey, add_verdicts, write_target_values
from hlp.settings import Doc, NotNegative, Settings
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages
from hlp.studies import bench_times
from hlp.studies.study_run import FrameCount, study_run

Detections = dict[str, list[bench_times.TimedDetection]]


@TASKS.register
@dataclass(frozen=True)
class BenchSettings(Settings):
    """Config group `task`: time and memory of detection, also with other settings."""

    name: Literal["bench"] = "bench"
    frames: FrameCount = 30
    same_mm: Annotated[NotNegative, Doc("two poses count as the same within this … (D)")] = 1.0
    same_deg: Annotated[NotNegative, Doc("… and this, up to the object's symmetries (D)")] = 0.5
    compared: Annotated[
        dict[str, dict[str, Any]],
        Doc(
            "other settings by name: what each changes, nested as in the whole configuration; "
            "a mapping with a name replaces a whole group"
        ),
    ] = field(default_factory=dict)

    def run(self, run: Run, output: Path) -> None:
        """Time every path on the same frames; write bench.json, .md, .png, .svg and targets.csv.

        A path is one set of settings: the configured one, and those of `compared`. Outputs of
        training are reused, or made first. Each path is run once before the measurement. Raises
        ConfigError naming a wrong key of `compared`, before anything is learnt.
        """
        paths = {CONFIGURED: run.settings}
        paths |= {name: with_changes(run, changes) for name, changes in self.compared.items()}
        with study_run(run, output) as (store, _):
            machine = bench_times.describe_machine(run.settings)
            keys = spread(run.keys, self.frames)
            for settings in paths.values():
                TrainingStages(run.dataset, settings.method, store).make_for(run.dataset.target_ids)
            frame = run.dataset.frames.load(keys[0])
            estimators, loaded, peak = _make_estimators(run, paths, store, frame)
            measured, verdicts = _summarise(run, self, keys, _measure(run, estimators, keys))
            result = {
                "machine": machine,
                "workload": _workload(run, estimators[CONFIGURED], frame, len(keys)),
                "loading_s": loaded,
                "memory": {"peak_mib": peak},
                "paths": measured,
                "tolerance": {"mm": self.same_mm, "deg": self.same_deg},
            }
            write_json(output / "bench.json", result)
            write_target_values(output, {ADD: verdicts}, run.dataset.names)
            write_text(output / "bench.md", format_bench(result, "markdown") + "\n")
            save_figure(bench_bars(result), output / "bench")
        print(format_bench(result))


def _summarise(
    run: Run, task: BenchSettings, keys: Sequence[str], detections: Detections
) -> tuple[dict[str, Any], dict[TargetKey, float]]:
    """Times, recall and agreement of the paths; verdicts by target of the configured one."""
    truths = [FrameTruth.of(run.dataset.frames.load(key)) for key in keys]
    models, evaluation = run.dataset.models, run.settings.evaluation
    scores = {
        name: score_targets(truths, models, [found.estimate for found in own], evaluation)
        for name, own in detections.items()
    }
    configured, paths = detections[CONFIGURED], {}
    for name, own in detections.items():
        same = bench_times.share_of_same(configured, own, models, (task.same_mm, task.same_deg))
        paths[name] = bench_times.summarise_path(own, scores[name]) | {"same_pose": same}
    return paths, add_verdicts(scores[CONFIGURED])


def _make_estimators(
    run: Run, paths: Mapping[str, RunSettings], store: StageStore, frame: Frame
) -> tuple[dict[str, PoseEstimator], dict[str, Any], float]:
    """The estimator of each path, loaded and warmed up on a frame.

    Also, for the configured path, which comes first, the loading time (s) and peak memory (MiB).
    """
    dataset = run.dataset
    estimators: dict[str, PoseEstimator] = {}
    for name, settings in paths.items():
        training = TrainingStages(dataset, settings.method, store)
        find = FindSettings.of(settings.method)
        estimators[name] = PoseEstimator(training, find, dataset.target_ids)
        objects = {number: dataset.models[number].name for number in dataset.target_ids}
        loading = bench_times.load_timed(estimators[name], objects)
        _detect_all(estimators[name], frame, tuple(dataset.instances_to_find(frame)))
        if name == CONFIGURED:
            loaded = loading
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    return estimators, loaded, peak


def _measure(run: Run, estimators: Mapping[str, PoseEstimator], keys: Sequence[str]) -> Detections:
    """Detections of every object in every frame by every path.

    The order of the paths rotates from frame to frame, so that other load on the machine affects
    all of them; so does the order of a frame's objects.
    """
    detections: Detections = {name: [] for name in estimators}
    for turn, key in enumerate(Progress(keys, desc="bench", unit="frame")):
        frame = run.dataset.frames.load(key)
        objects = np.roll([*run.dataset.instances_to_find(frame)], -turn).tolist()
        for name in np.roll([*estimators], -turn).tolist():
            detections[name] += _detect_all(estimators[name], frame, objects)
    return detections


def _detect_all(
    estimator: PoseEstimator, frame: Frame, object_ids: Sequence[int]
) -> list[bench_times.TimedDetection]:
    """Find every object in one frame; what they share is part of the first one's time."""
    found = []
    clock, context = bench_times.PartClock(), None
    for place, object_id in enumerate(object_ids):
        context = estimator.prepare(frame, observer=clock.enter) if context is None else context
        trace = search_frame(context, {object_id: 1}, by_threads=False)[object_id]
        spent, refined = clock.stop(), trace.refined
        pose = None if refined is None else refined.chosen_poses[0]
        estimate = PoseEstimate(frame.scene_id, frame.frame_id, object_id, pose, 1.0)
        found.append(bench_times.TimedDetection(estimate, place, spent))
    return found


def _workload(run: Run, estimator: PoseEstimator, frame: Frame, frames: int) -> dict[str, Any]:
    """What decides the time of the measured detections."""
    settings, objects = run.settings, run.dataset.target_ids
    books = [estimator.matching.group(i).codebooks[i].features for i in objects]
    height, width = frame.depth.shape
    return {
        "experiment": settings.name,
        "data": str(run.config["data"]["name"]),
        "frames": frames,
        "image": f"{width} x {height}",
        "objects": len(objects),
        "codebook_entries": sum(map(len, books)),
        "scan": settings.patches.region.scan,
        "codebook": settings.codebook.name,
        "refinement": settings.refinement.name,
        "particles": getattr(settings.refinement, "particles", None),
        "refined": settings.refinement.verification.candidates,
    }
