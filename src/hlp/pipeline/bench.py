"""What detection costs: every part's time, memory, and the same frames through slower paths."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.pipeline.bench_summary import (
    Look,
    compare_paths,
    ratios,
    summarise_path,
    summarise_search,
    summarise_whole,
)
from hlp.pipeline.build import Run, build_world, vary
from hlp.pipeline.instrument import frames_looked_at, instrument_run
from hlp.pipeline.learning import Learner
from hlp.pipeline.machine import describe_machine, peak_mib
from hlp.pipeline.manifest import write_json
from hlp.pipeline.settings import BenchSettings, RunSettings
from hlp.pipeline.stopwatch import SearchTried, TimedDetector
from hlp.pipeline.store import StageStore
from hlp.records import Frame, LocalPatches, PoseEstimate, TargetScore
from hlp.reporting.bench_table import OWN, VIEWS, bench_metrics, format_bench, write_bench

FILE = "bench.json"
Detectors = Mapping[str, TimedDetector]
Looks = dict[str, list[Look]]


def run(planned: Run, task: BenchSettings, output: Path) -> dict[str, Any]:
    """Time every path on the same frames; write bench.json, bench.md and manifest.json.

    What is learnt is reused, or made first. The first frame is looked at once before, untimed.
    Raises ValueError naming a key of `task.compared` that is wrong, before anything is learnt.
    """
    paths = {OWN: planned.settings}
    paths |= {name: vary(planned, changes) for name, changes in task.compared.items()}
    with instrument_run(planned, output) as (store, tracker):
        machine = describe_machine(planned.settings)
        keys = frames_looked_at(planned, task.frames)
        for settings in paths.values():
            _learn(Learner(planned.world, settings, store))
        made = sorted({event.stage for event in store.events if not event.reused})
        found = _find_again(planned)
        frame = planned.world.frames.load(keys[0])
        detectors, loaded, peak = _make_detectors(planned, paths, store, frame)
        looks, searches = _measure(planned, detectors, keys)
        everything = _regions_of_all(planned, store, keys)
        memory = {"peak_mib": peak, "all_paths_mib": peak_mib(), "learnt_too": made}
        result = {
            "machine": machine,
            "workload": _workload(planned, detectors[OWN], frame, len(keys)),
            "loading_s": {**found, **loaded},
            "memory": memory,
            **_summary(planned, task, keys, looks),
            "search": summarise_search(searches),
            "regions_of_all": everything,
        }
        write_json(output / FILE, result)
        write_bench(output, result)
        tracker.log_metrics(bench_metrics(result))
    print(format_bench(result))
    return result


def _learn(learner: Learner) -> None:
    """Have everything on disk that detection loads."""
    learner.classifier()
    learner.encoder()
    for object_id in learner.world.target_ids:
        learner.codebook(object_id)


def _find_again(planned: Run) -> dict[str, Any]:
    """Seconds to read the objects' models, and to find what was learnt about them by its inputs."""
    begun = time.perf_counter()
    world = build_world(planned.settings)
    read = time.perf_counter()
    _learn(Learner(world, planned.settings, StageStore(Path(planned.settings.work))))
    return {"models": read - begun, "finding": time.perf_counter() - read}


def _make_detectors(
    planned: Run, paths: Mapping[str, RunSettings], store: StageStore, frame: Frame
) -> tuple[Detectors, dict[str, Any], float]:
    """Each path's detector, loaded and warmed up on a frame.

    Of the configured one, which comes first, also the seconds of loading and the peak memory (MiB).
    """
    world = planned.world
    detectors: dict[str, TimedDetector] = {}
    for name, settings in paths.items():
        detectors[name] = TimedDetector(world, settings, Learner(world, settings, store))
        loading = detectors[name].load(world.target_ids)
        for place, object_id in enumerate(world.wanted(frame)):
            _look(detectors[name], frame, object_id, place)
        if name == OWN:
            shared = {"classifier": loading.classifier, "encoder": loading.encoder}
            objects = {world.models[i].name: each for i, each in loading.objects.items()}
            loaded, peak = {**shared, "objects": objects}, peak_mib()
    return detectors, loaded, peak


def _measure(
    planned: Run, detectors: Detectors, keys: Sequence[str]
) -> tuple[Looks, list[SearchTried]]:
    """Every path's look at every object of every frame, and the searches of the configured one.

    The paths take turns to be first, so that whatever else the machine does meets all of them; so
    do the objects of a frame.
    """
    looks: Looks = {name: [] for name in detectors}
    searches = []
    names = list(detectors)
    for turn, key in enumerate(tqdm(keys, desc="bench", unit="frame", disable=None)):
        frame = planned.world.frames.load(key)
        objects = _rotated(planned.world.wanted(frame), turn)
        for name in _rotated(names, turn):
            for place, object_id in enumerate(objects):
                look, patches = _look(detectors[name], frame, object_id, place)
                looks[name].append(look)
                if name == OWN:
                    tried = detectors[name].try_search(object_id, patches)
                    searches += [] if tried is None else [tried]
    return looks, searches


def _regions_of_all(planned: Run, store: StageStore, keys: Sequence[str]) -> dict[str, Any]:
    """Stage 1 for every object that the classifier knows, asked for or not, frame by frame."""
    object_ids = tuple(planned.world.models)
    world = replace(planned.world, target_ids=object_ids)
    learner = Learner(planned.world, planned.settings, store)
    detector = TimedDetector(world, planned.settings, learner)
    detector.load(())
    spent = []
    for key in tqdm(keys, desc="regions of all objects", unit="frame", disable=None):
        frame = world.frames.load(key)
        detector.clock.start()
        for object_id in object_ids:
            detector.region(frame, object_id)
        spent.append(detector.clock.stop())
    return {"objects": len(object_ids), **summarise_whole(spent)}


def _rotated(values: Sequence[Any], turn: int) -> list[Any]:
    start = turn % max(len(values), 1)
    return [*values[start:], *values[:start]]


def _look(
    detector: TimedDetector, frame: Frame, object_id: int, place: int
) -> tuple[Look, LocalPatches]:
    """One object in one frame, from image to pose."""
    detector.clock.start()
    region = detector.region(frame, object_id)
    coarse = detector.coarse(frame, region)
    fine = detector.fine(frame, object_id, coarse.hypotheses)
    spent = detector.clock.stop()
    pose = None if fine is None else fine.refined[fine.best].pose_cam_obj
    estimate = PoseEstimate(frame.scene_id, frame.frame_id, object_id, pose, 1.0)
    return Look(estimate, place, spent, np.packbits(region.mask)), coarse.patches


def _summary(
    planned: Run, task: BenchSettings, keys: Sequence[str], looks: Looks
) -> dict[str, Any]:
    """Times and recall of every path, and each beside the configured one."""
    models = planned.world.models
    truths = [FrameTruth.of(planned.world.frames.load(key)) for key in keys]
    scores: dict[str, list[TargetScore]] = {
        name: score_targets(
            truths, models, [each.estimate for each in own], planned.settings.evaluation
        )
        for name, own in looks.items()
    }
    paths = {name: summarise_path(own, scores[name]) for name, own in looks.items()}
    compared = {}
    for name, changes in task.compared.items():
        found = compare_paths(looks, scores, models, (OWN, name), (task.same_mm, task.same_deg))
        ratio = {view: ratios(paths[OWN][view], paths[name][view]) for view in VIEWS}
        compared[name] = {"changes": changes, "ratio": ratio, **found}
    tolerance = {"mm": task.same_mm, "deg": task.same_deg}
    return {"paths": paths, "compared": compared, "tolerance": tolerance}


def _workload(planned: Run, detector: TimedDetector, frame: Frame, frames: int) -> dict[str, Any]:
    """What was measured, as far as it decides the time."""
    settings, world = planned.settings, planned.world
    refinement = settings.refinement
    height, width = frame.depth.shape
    return {
        "experiment": settings.name,
        "data": str(planned.config["data"]["name"]),
        "frames": frames,
        "image": [width, height],
        "objects": {
            world.models[i].name: {
                "codebook_entries": detector.entries(i),
                "proxy_faces": len(world.models[i].proxy.faces),
            }
            for i in world.target_ids
        },
        "classes": len(world.models) + 1,
        "scan": settings.patches.region.scan,
        "codebook": settings.codebook.name,
        "voting": settings.voting.name,
        "refinement": refinement.name,
        "particles": getattr(refinement, "particles", None),
        "refined": refinement.verification.candidates,
    }
