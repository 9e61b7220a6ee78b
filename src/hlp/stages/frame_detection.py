"""The three detection stages on one frame: their results and times."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hlp.method.find.conflicts import Found, resolve_conflicts
from hlp.method.find.estimator import FrameContext, PoseEstimator
from hlp.method.find.instances import find_instances
from hlp.records import Frame, PoseEstimate
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.score_model import ScoreModel
from hlp.stages.frame_results import (
    Arrays,
    coarse_arrays,
    hypotheses_of,
    refined_arrays,
    region_arrays,
    regions_of,
)

STAGES = ("regions", "hypotheses", "poses")
STEPS = ("holistic", "local", "voting", "refinement")
"""Steps whose time is measured; the stage `hypotheses` has two of them."""

Seconds = dict[int, dict[str, float]]
"""Wall time (s) by object and step in one frame."""


def find_in_frame(
    estimator: PoseEstimator,
    frame: Frame,
    wanted: Mapping[int, int],
    stages: Sequence[str],
    given: Mapping[str, Arrays],
) -> tuple[dict[str, Arrays], Seconds]:
    """Arrays of each of the `stages`, found in this order, and the time of each object's steps.

    `wanted` are the objects to find, by id, with the largest number of instances of each; `given`
    holds the arrays of the stages before the first of them. Work that the objects of a
    frame share counts for the first one.
    """
    seconds: Seconds = {object_id: {} for object_id in wanted}
    found: dict[str, Arrays] = {}
    begun = time.perf_counter()
    context = estimator.prepare(frame)
    shared = time.perf_counter() - begun
    for stage in stages:
        found[stage] = _FIND[stage](estimator, context, wanted, {**given, **found}, seconds)
    if "regions" in stages and wanted:
        seconds[next(iter(wanted))]["holistic"] += shared
    return found, seconds


def _regions(
    estimator: PoseEstimator,
    context: FrameContext,
    wanted: Mapping[int, int],
    before: Mapping[str, Arrays],
    seconds: Seconds,
) -> Arrays:
    arrays: Arrays = {}
    for object_id, spent in seconds.items():
        begun = time.perf_counter()
        region = estimator.find_region(context, object_id)
        spent["holistic"] = time.perf_counter() - begun
        arrays |= region_arrays(region)
    return arrays


def _hypotheses(
    estimator: PoseEstimator,
    context: FrameContext,
    wanted: Mapping[int, int],
    before: Mapping[str, Arrays],
    seconds: Seconds,
) -> Arrays:
    height, width = context.frame.depth.shape
    regions = regions_of(before["regions"], (height, width))
    arrays: Arrays = {}
    for object_id, spent in seconds.items():
        coarse = estimator.find_hypotheses(context, regions[object_id])
        spent |= {"local": coarse.local_seconds, "voting": coarse.voting_seconds}
        arrays |= coarse_arrays(object_id, coarse)
    return arrays


def _poses(
    estimator: PoseEstimator,
    context: FrameContext,
    wanted: Mapping[int, int],
    before: Mapping[str, Arrays],
    seconds: Seconds,
) -> Arrays:
    found: Found = {}
    height, width = context.frame.depth.shape
    regions = regions_of(before["regions"], (height, width))
    hypotheses = {i: hypotheses_of(before["hypotheses"], i) for i in wanted}
    for object_id, spent in seconds.items():
        begun = time.perf_counter()
        found[object_id] = find_instances(
            estimator, context, regions[object_id], hypotheses[object_id], wanted[object_id]
        )
        spent["refinement"] = time.perf_counter() - begun
    begun = time.perf_counter()
    found = resolve_conflicts(estimator, context, found, regions, hypotheses, wanted)
    shared = (time.perf_counter() - begun) / max(len(found), 1)
    arrays: Arrays = {}
    for object_id, refined in found.items():
        seconds[object_id]["refinement"] += shared
        begun = time.perf_counter()
        chosen = [] if refined is None else [refined.refined[row] for row in refined.instances]
        fits = [estimator.measure_fit(context, object_id, each.pose_cam_obj) for each in chosen]
        arrays |= refined_arrays(object_id, refined, fits)
        seconds[object_id]["refinement"] += time.perf_counter() - begun
    return arrays


_FIND: Mapping[str, Any] = {"regions": _regions, "hypotheses": _hypotheses, "poses": _poses}


def estimates_of(
    key: str, stored: Arrays, seconds: Seconds, scores: Mapping[int, ScoreModel]
) -> list[PoseEstimate]:
    """The instances of every object looked for in a frame, from the arrays of the stage `poses`.

    `scores` are the objects' score models by id. There is one estimate, without a pose, of an
    object that was not found. `seconds` are the times measured in that frame; the instances of an
    object share its time equally. An estimate has a time only if every step was measured.
    """
    timed = {i: spent for i, spent in seconds.items() if set(STEPS) <= spent.keys()}
    scene_id, frame_id = (int(part) for part in key.split("_"))
    object_ids = sorted({int(name.partition("/")[0]) for name in stored})
    estimates = []
    for i in object_ids:
        instances = _instances(stored, i, scores[i])
        shared = {step: spent / len(instances) for step, spent in timed.get(i, {}).items()}
        estimates += [PoseEstimate(scene_id, frame_id, i, *each, shared) for each in instances]
    return estimates


def _instances(
    stored: Arrays, object_id: int, model: ScoreModel
) -> list[tuple[np.ndarray | None, float]]:
    """Pose and score of each instance; None and 0 if there is none."""
    if f"{object_id}/instances" not in stored:
        return [(None, 0.0)]
    poses, rows = stored[f"{object_id}/poses"], stored[f"{object_id}/instances"]
    scores = [model.score(PoseFit.from_array(fit)) for fit in stored[f"{object_id}/fits"]]
    return list(zip(poses[rows], scores, strict=True))
