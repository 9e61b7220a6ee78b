"""Time and memory of each part of detection, and of other settings on the same frames."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge

from hlp.config.build import Run, sampled_keys, with_changes
from hlp.config.settings import TASKS, RunSettings
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.files import write_json, write_text
from hlp.method.find.detections import describe_all
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import search_frame
from hlp.method.settings import FindSettings
from hlp.progress import Progress
from hlp.records import Frame, PoseEstimate
from hlp.reporting.bench_tables import CONFIGURED, TIMED, bench_metrics, format_bench
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.bars import bench_bars
from hlp.results.recalls import TargetKey, write_target_values
from hlp.settings import Doc, Settings
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages
from hlp.studies.bench_times import (
    PartClock,
    Spent,
    TimedDetection,
    bench_targets,
    compare_paths,
    describe_machine,
    load_timed,
    peak_mib,
    summarise_path,
    summarise_spent,
)
from hlp.studies.study_run import FrameCount, object_names, study_run

Detections = dict[str, list[TimedDetection]]


@TASKS.register
@dataclass(frozen=True)
class BenchSettings(Settings):
    """Config group `task`: time and memory of detection, also with other settings."""

    name: Literal["bench"] = "bench"
    frames: FrameCount = 30
    same_mm: Annotated[float, Ge(0), Doc("two poses count as the same within this … (D)")] = 1.0
    same_deg: Annotated[float, Ge(0), Doc("… and this, up to the object's symmetries (D)")] = 0.5
    compared: Annotated[
        dict[str, dict[str, Any]],
        Doc(
            "other settings by name: what each changes, nested as in the whole configuration; "
            "a mapping with a name replaces a whole group"
        ),
    ] = field(default_factory=dict)

    def run(self, run: Run, output: Path) -> None:
        """See `run_bench`."""
        run_bench(run, self, output)


def run_bench(run: Run, task: BenchSettings, output: Path) -> dict[str, Any]:
    """Time every path on the same frames; write bench.json, .md, .png, .svg and targets.csv.

    A path is one set of settings: the configured one, and those of `task.compared`. Outputs of
    training are reused, or made first. Each path is run once before the measurement. Raises
    ConfigError naming a wrong key of `task.compared`, before anything is learnt.
    """
    paths = {CONFIGURED: run.settings}
    paths |= {name: with_changes(run, changes) for name, changes in task.compared.items()}
    with study_run(run, output) as (store, tracker):
        machine = describe_machine(run.settings)
        keys = sampled_keys(run.keys, task.frames)
        for settings in paths.values():
            TrainingStages(run.dataset, settings.method, store).make_for(run.dataset.target_ids)
        made = sorted({event.stage for event in store.events if not event.reused})
        found = _find_again(run)
        frame = run.dataset.frames.load(keys[0])
        estimators, loaded, peak = _make_estimators(run, paths, store, frame)
        detections = _measure(run, estimators, keys)
        memory = {"peak_mib": peak, "all_paths_mib": peak_mib(), "learnt_too": made}
        summary, targets = _summarise(run, task, keys, detections)
        result = {
            "machine": machine,
            "workload": _workload(run, estimators[CONFIGURED], frame, len(keys)),
            "loading_s": {**found, **loaded},
            "memory": memory,
            **summary,
            "objects_at_once": _objects_at_once(run, estimators[CONFIGURED], keys),
        }
        write_json(output / "bench.json", result)
        write_target_values(output, targets, object_names(run))
        write_text(output / "bench.md", format_bench(result, "markdown") + "\n")
        save_figure(bench_bars(result), output / "bench")
        tracker.log_metrics(bench_metrics(result))
    print(format_bench(result))
    return result


def _summarise(
    run: Run, task: BenchSettings, keys: Sequence[str], detections: Detections
) -> tuple[dict[str, Any], dict[str, dict[TargetKey, float]]]:
    """Times, recall and agreement of the paths; times and verdicts by target of the configured."""
    truths = [FrameTruth.of(run.dataset.frames.load(key)) for key in keys]
    models, evaluation = run.dataset.models, run.settings.evaluation
    scores = {
        name: score_targets(truths, models, [found.estimate for found in own], evaluation)
        for name, own in detections.items()
    }
    times = {name: summarise_path(own, scores[name]) for name, own in detections.items()}
    tolerance, compared = (task.same_mm, task.same_deg), {}
    for name, changes in task.compared.items():
        ratio = {view: ratios(times[CONFIGURED][view], times[name][view]) for view in TIMED}
        agreed = compare_paths(detections, scores, models, (CONFIGURED, name), tolerance)
        compared[name] = {"changes": changes, "ratio": ratio, **agreed}
    limits = dict(zip(("mm", "deg"), tolerance, strict=True))
    summary = {"paths": times, "compared": compared, "tolerance": limits}
    return summary, bench_targets(detections[CONFIGURED], scores[CONFIGURED])


def _find_again(run: Run) -> dict[str, float]:
    """Seconds to read the objects' models, and to find their training outputs in the store."""
    begun = time.perf_counter()
    dataset = run.settings.data.build()
    read = time.perf_counter()
    store = StageStore(Path(run.settings.work))
    TrainingStages(dataset, run.settings.method, store).make_for(dataset.target_ids)
    return {"models": read - begun, "finding": time.perf_counter() - read}


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
        loading = load_timed(estimators[name], objects)
        _detect_all(estimators[name], frame, tuple(dataset.instances_to_find(frame)))
        if name == CONFIGURED:
            loaded, peak = loading, peak_mib()
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
) -> list[TimedDetection]:
    """Find every object in one frame; what they share is part of the first one's time."""
    found = []
    clock, context = PartClock(), None
    for place, object_id in enumerate(object_ids):
        context = estimator.prepare(frame, observer=clock.enter) if context is None else context
        trace = search_frame(context, {object_id: 1}, by_threads=False)[object_id]
        spent, refined = clock.stop(), trace.refined
        assert trace.region is not None
        pose = None if refined is None else refined.refined[refined.best].pose_cam_obj
        estimate = PoseEstimate(frame.scene_id, frame.frame_id, object_id, pose, 1.0)
        found.append(TimedDetection(estimate, place, spent, np.packbits(trace.region.mask)))
    return found


def _objects_at_once(run: Run, estimator: PoseEstimator, keys: Sequence[str]) -> dict[str, float]:
    """Times of whole frames whose objects are searched at once by several threads.

    So do `Detector` and `hlp predict`. The paths search one after another, to measure the parts.
    """
    spent = []
    for key in Progress(keys, desc="objects at once", unit="frame"):
        frame = run.dataset.frames.load(key)
        begun, busy = time.perf_counter(), time.process_time()
        context, counts = estimator.prepare(frame), run.dataset.instances_to_find(frame)
        trace = search_frame(context, counts, min_score=0.0)
        describe_all(context, trace)
        spent.append(Spent(time.perf_counter() - begun, time.process_time() - busy))
    return summarise_spent(spent)


def _workload(run: Run, estimator: PoseEstimator, frame: Frame, frames: int) -> dict[str, Any]:
    """What decides the time of the measured detections."""
    settings, dataset = run.settings, run.dataset
    refinement = settings.refinement
    height, width = frame.depth.shape
    return {
        "experiment": settings.name,
        "data": str(run.config["data"]["name"]),
        "frames": frames,
        "image": [width, height],
        "objects": {
            dataset.models[i].name: {
                "codebook_entries": len(estimator.matching.group(i).codebooks[i].features),
                "proxy_faces": len(dataset.models[i].proxy.faces),
            }
            for i in dataset.target_ids
        },
        "classes": len(dataset.models) + 1,
        "scan": settings.patches.region.scan,
        "codebook": settings.codebook.name,
        "voting": settings.voting.name,
        "refinement": refinement.name,
        "particles": getattr(refinement, "particles", None),
        "refined": refinement.verification.candidates,
    }


def ratios(
    own: Mapping[str, Mapping[str, float]], other: Mapping[str, Mapping[str, float]]
) -> dict[str, float | None]:
    """By part, the ratio of the other's median time to the own one; None where that is 0."""
    return {
        name: other[name]["median_ms"] / time["median_ms"] if time["median_ms"] else None
        for name, time in own.items()
        if name in other
    }
