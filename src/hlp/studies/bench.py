"""What detection costs: every part's time, memory, and the same frames through slower paths."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from hlp.config.build import Run, with_changes
from hlp.config.settings import BenchSettings, RunSettings
from hlp.data.loading import build_dataset
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.files import write_json
from hlp.method.pose_estimator import FrameContext
from hlp.records import Frame, LocalPatches, PoseEstimate, TargetScore
from hlp.reporting.tables.bench_table import (
    CONFIGURED,
    TIMED,
    bench_metrics,
    format_bench,
    write_bench,
)
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages
from hlp.studies.bench_summary import (
    TimedDetection,
    compare_paths,
    ratios,
    summarise_path,
    summarise_search,
    summarise_whole,
)
from hlp.studies.machine import describe_machine, peak_mib
from hlp.studies.stopwatch import SearchComparison, TimedEstimator
from hlp.studies.study_run import chosen_frames, study_run

FILE = "bench.json"
Detectors = Mapping[str, TimedEstimator]
Looks = dict[str, list[TimedDetection]]


def run_bench(run: Run, task: BenchSettings, output: Path) -> dict[str, Any]:
    """Time every path on the same frames; write bench.json, bench.md and manifest.json.

    What is learnt is reused, or made first. The first frame is looked at once before, untimed.
    Raises ValueError naming a key of `task.compared` that is wrong, before anything is learnt.
    """
    paths = {CONFIGURED: run.settings}
    paths |= {name: with_changes(run, changes) for name, changes in task.compared.items()}
    with study_run(run, output) as (store, tracker):
        machine = describe_machine(run.settings)
        keys = chosen_frames(run, task.frames)
        for settings in paths.values():
            TrainingStages(run.dataset, settings.method, store).make_for(run.dataset.target_ids)
        made = sorted({event.stage for event in store.events if not event.reused})
        found = _find_again(run)
        frame = run.dataset.frames.load(keys[0])
        detectors, loaded, peak = _make_detectors(run, paths, store, frame)
        looks, searches = _measure(run, detectors, keys)
        everything = _regions_of_all(run, store, keys)
        memory = {"peak_mib": peak, "all_paths_mib": peak_mib(), "learnt_too": made}
        result = {
            "machine": machine,
            "workload": _workload(run, detectors[CONFIGURED], frame, len(keys)),
            "loading_s": {**found, **loaded},
            "memory": memory,
            **_summary(run, task, keys, looks),
            "search": summarise_search(searches),
            "regions_of_all": everything,
        }
        write_json(output / FILE, result)
        write_bench(output, result)
        tracker.log_metrics(bench_metrics(result))
    print(format_bench(result))
    return result


def _find_again(run: Run) -> dict[str, Any]:
    """Seconds to read the objects' models, and to find what was learnt about them by its inputs."""
    begun = time.perf_counter()
    dataset = build_dataset(run.settings.data)
    read = time.perf_counter()
    store = StageStore(Path(run.settings.work))
    TrainingStages(dataset, run.settings.method, store).make_for(dataset.target_ids)
    return {"models": read - begun, "finding": time.perf_counter() - read}


def _make_detectors(
    run: Run, paths: Mapping[str, RunSettings], store: StageStore, frame: Frame
) -> tuple[Detectors, dict[str, Any], float]:
    """Each path's detector, loaded and warmed up on a frame.

    Of the configured one, which comes first, also the seconds of loading and the peak memory (MiB).
    """
    dataset = run.dataset
    detectors: dict[str, TimedEstimator] = {}
    for name, settings in paths.items():
        detectors[name] = TimedEstimator(
            TrainingStages(dataset, settings.method, store), settings.method, dataset.target_ids
        )
        loading = detectors[name].load_timed(dataset.target_ids)
        _look_for_all(detectors[name], frame, dataset.wanted(frame))
        if name == CONFIGURED:
            shared = {"classifier": loading.classifier, "encoder": loading.encoder}
            objects = {dataset.models[i].name: each for i, each in loading.objects.items()}
            loaded, peak = {**shared, "objects": objects}, peak_mib()
    return detectors, loaded, peak


def _measure(
    run: Run, detectors: Detectors, keys: Sequence[str]
) -> tuple[Looks, list[SearchComparison]]:
    """Every path's look at every object of every frame, and the searches of the configured one.

    The paths take turns to be first, so that whatever else the machine does meets all of them; so
    do the objects of a frame.
    """
    looks: Looks = {name: [] for name in detectors}
    searches = []
    names = list(detectors)
    for turn, key in enumerate(tqdm(keys, desc="bench", unit="frame", disable=None)):
        frame = run.dataset.frames.load(key)
        objects = _rotated(run.dataset.wanted(frame), turn)
        for name in _rotated(names, turn):
            for look, patches in _look_for_all(detectors[name], frame, objects):
                looks[name].append(look)
                if name == CONFIGURED:
                    object_id = look.estimate.object_id
                    tried = detectors[name].compare_search(object_id, patches)
                    searches += [] if tried is None else [tried]
    return looks, searches


def _regions_of_all(run: Run, store: StageStore, keys: Sequence[str]) -> dict[str, Any]:
    """Stage 1 for every object that the classifier knows, asked for or not, frame by frame."""
    object_ids = tuple(run.dataset.models)
    dataset = replace(run.dataset, target_ids=object_ids)
    training = TrainingStages(run.dataset, run.settings.method, store)
    detector = TimedEstimator(training, run.settings.method, object_ids)
    detector.load_timed(())
    spent = []
    for key in tqdm(keys, desc="regions of all objects", unit="frame", disable=None):
        frame = dataset.frames.load(key)
        detector.clock.start()
        context = detector.prepare(frame)
        for object_id in object_ids:
            detector.find_region(context, object_id)
        spent.append(detector.clock.stop())
    return {"objects": len(object_ids), **summarise_whole(spent)}


def _rotated(values: Sequence[Any], turn: int) -> list[Any]:
    start = turn % max(len(values), 1)
    return [*values[start:], *values[:start]]


def _look_for_all(
    detector: TimedEstimator, frame: Frame, object_ids: Sequence[int]
) -> list[tuple[TimedDetection, LocalPatches]]:
    """Every object in one frame, from image to pose; what they share is the first one's time."""
    found = []
    context: FrameContext | None = None
    for place, object_id in enumerate(object_ids):
        detector.clock.start()
        context = detector.prepare(frame) if context is None else context
        region = detector.find_region(context, object_id)
        coarse = detector.find_hypotheses(context, region)
        refined = detector.refine(context, object_id, coarse.hypotheses)
        spent = detector.clock.stop()
        pose = None if refined is None else refined.refined[refined.best].pose_cam_obj
        estimate = PoseEstimate(frame.scene_id, frame.frame_id, object_id, pose, 1.0)
        timed = TimedDetection(estimate, place, spent, np.packbits(region.mask))
        found.append((timed, coarse.patches))
    return found


def _summary(run: Run, task: BenchSettings, keys: Sequence[str], looks: Looks) -> dict[str, Any]:
    """Times and recall of every path, and each beside the configured one."""
    models = run.dataset.models
    truths = [FrameTruth.of(run.dataset.frames.load(key)) for key in keys]
    scores: dict[str, list[TargetScore]] = {
        name: score_targets(
            truths, models, [each.estimate for each in own], run.settings.evaluation
        )
        for name, own in looks.items()
    }
    paths = {name: summarise_path(own, scores[name]) for name, own in looks.items()}
    compared = {}
    for name, changes in task.compared.items():
        found = compare_paths(
            looks, scores, models, (CONFIGURED, name), (task.same_mm, task.same_deg)
        )
        ratio = {view: ratios(paths[CONFIGURED][view], paths[name][view]) for view in TIMED}
        compared[name] = {"changes": changes, "ratio": ratio, **found}
    tolerance = {"mm": task.same_mm, "deg": task.same_deg}
    return {"paths": paths, "compared": compared, "tolerance": tolerance}


def _workload(run: Run, detector: TimedEstimator, frame: Frame, frames: int) -> dict[str, Any]:
    """What was measured, as far as it decides the time."""
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
                "codebook_entries": detector.entries(i),
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
