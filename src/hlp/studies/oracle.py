"""Oracle matrix: what each stage loses, found by replacing its output by the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from hlp.arrays import Pose, spread
from hlp.config.build import Run
from hlp.config.settings import TASKS
from hlp.data.dataset import annotated_mask
from hlp.evaluation import EvaluationSettings
from hlp.evaluation.bop_recalls import measured_mask
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.evaluation.summary import with_interval
from hlp.evaluation.waterfall import by_object
from hlp.files import write_json, write_text
from hlp.method.find.estimator import FrameContext
from hlp.method.find.search import search_frame
from hlp.method.find.trace import ObjectTrace
from hlp.progress import Progress
from hlp.records import Frame, Hypotheses, PoseEstimate, Region, TargetScore, parse_frame_key
from hlp.reporting.figures import save_figure
from hlp.reporting.figures.heat_maps import oracle_map
from hlp.reporting.study_tables import format_oracle, head_of
from hlp.results.recalls import METRICS, add_verdicts, write_target_values
from hlp.runs.runner import stages_of
from hlp.settings import Doc, NotNegative, Settings
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore
from hlp.stages.trace_files import read_arrays
from hlp.studies.study_run import FrameCount, stage_of_frames, study_code, study_run

Cell = tuple[str, str]
CELLS: tuple[Cell, ...] = (
    ("estimated", "estimated"),
    ("true", "estimated"),
    ("estimated", "true"),
    ("true", "true"),
)
"""Region and coarse pose of each column; the fine pose is estimated in all of them."""


@TASKS.register
@dataclass(frozen=True)
class OracleSettings(Settings):
    """Config group `task`: how much recall each stage loses.

    ADD(-S) recall with estimated and with true regions and coarse poses.
    """

    name: Literal["oracle"] = "oracle"
    frames: FrameCount = 30
    agree_mm: Annotated[
        NotNegative,
        Doc("without masks, a target is visible where depth differs by at most this (D)"),
    ] = 20.0

    def run(self, run: Run, output: Path) -> None:
        """Write oracle.md, .json, .png and .svg, targets.csv and manifest.json.

        Regions and hypotheses are those of the run's stages. The poses found here are a stage too,
        so an interrupted run continues where it stopped. Everything is logged as one MLflow run.
        """
        dataset, settings = run.dataset, run.settings
        with study_run(run, output) as (store, _):
            keys = spread(run.keys, self.frames)
            found = _read(_stage(run, stages_of(run, store), self, keys, store), keys)
            loaded = Progress(keys, desc="scores", unit="frame")
            truths = [FrameTruth.of(dataset.frames.load(key)) for key in loaded]
            scores = {
                cell: score_targets(truths, dataset.models, found[cell], settings.evaluation)
                for cell in CELLS
            }
            names = dataset.names
            matrix = summarise_oracle(scores, names, settings.evaluation, settings.seed)
            result = {"frames": len(keys), **matrix}
            write_json(output / "oracle.json", result)
            verdicts = {head_of(*cell): add_verdicts(found) for cell, found in scores.items()}
            write_target_values(output, verdicts, names)
            write_text(output / "oracle.md", format_oracle(result, "markdown") + "\n")
            save_figure(oracle_map(result), output / "oracle")
        print(format_oracle(result))


def _stage(
    run: Run,
    detection: DetectionStages,
    task: OracleSettings,
    keys: Sequence[str],
    store: StageStore,
) -> Path:
    """Folder with the pose of every target in every cell."""
    settings = detection.settings
    decided = {"agree_mm": task.agree_mm, "refinement": settings.refinement}
    upstream = {"hypotheses": detection.make("hypotheses").fingerprint}
    chosen = (settings.encoder, settings.codebook, settings.voting, settings.refinement)
    code = study_code(__name__, *chosen, run.dataset.frames)
    find = partial(_find, detection, task)
    return stage_of_frames("oracle", run, store, keys, find, code, decided, upstream)


def _find(detection: DetectionStages, task: OracleSettings, frame: Frame) -> dict[str, np.ndarray]:
    """Poses of one frame, named `object/region/coarse`; absent if nothing was found."""
    context = detection.estimator.prepare(frame)
    stored = detection.read(frame.key, ("regions", "hypotheses"))
    by_cell = partial(_poses_by_cell, detection, context, task=task)
    return {
        f"{object_id}/{region}/{coarse}": np.stack(poses)
        for object_id in detection.dataset.instances_to_find(frame)
        for (region, coarse), poses in by_cell(stored[object_id]).items()
        if poses
    }


def _poses_by_cell(
    detection: DetectionStages, context: FrameContext, stored: ObjectTrace, task: OracleSettings
) -> dict[Cell, list[Pose]]:
    """Refined poses of an object's targets in every cell.

    With estimated regions and coarse poses all are looked for at once, else each by itself. A true
    coarse pose stands for perfect votes. Votes need visible patches, so the true coarse pose is
    given only if the region shows a part of the target.
    """
    assert stored.region is not None
    frame, object_id = context.frame, stored.region.object_id
    targets = [target for target in frame.targets if target.object_id == object_id]
    found: dict[Cell, list[Pose]] = {cell: [] for cell in CELLS}
    found["estimated", "estimated"] = _refined(context, stored, len(targets))
    for target in targets:
        visible = annotated_mask(detection.dataset.frames, frame, target)
        if visible is None:
            model = detection.dataset.models[object_id]
            visible = measured_mask(frame, target, model, task.agree_mm / 1e3)
        true = ObjectTrace(Region(object_id, np.zeros((0, 2)), np.zeros(0), visible))
        found["true", "estimated"] += _refined(context, true)
        coarse = Hypotheses(target.pose_cam_obj[None], np.ones(1))
        of_true = _refined(context, replace(stored, hypotheses=coarse))
        found["estimated", "true"] += of_true if (stored.region.mask & visible).any() else []
        found["true", "true"] += of_true if visible.any() else []
    return found


def _refined(context: FrameContext, given: ObjectTrace, instances: int = 1) -> list[Pose]:
    """What a search from a region, or from coarse poses, finds without the fallback."""
    assert given.region is not None
    object_id = given.region.object_id
    counts, start = {object_id: instances}, {object_id: given}
    trace = search_frame(context, counts, given=start, fallback=False, by_threads=False)
    refined = trace[object_id].refined
    return [] if refined is None else refined.chosen_poses


def _read(folder: Path, keys: Sequence[str]) -> dict[Cell, list[PoseEstimate]]:
    """Estimates of each cell, from disk."""
    estimates: dict[Cell, list[PoseEstimate]] = {cell: [] for cell in CELLS}
    for key in keys:
        for name, poses in read_arrays(folder, key).items():
            object_id, region, coarse = name.split("/")
            of = (*parse_frame_key(key), int(object_id))
            estimates[region, coarse] += [PoseEstimate(*of, pose, 1.0) for pose in poses]
    return estimates


def summarise_oracle(
    scores: Mapping[Cell, Sequence[TargetScore]],
    names: Mapping[int, str],
    evaluation: EvaluationSettings,
    seed: int,
) -> dict[str, Any]:
    """Content of `oracle.json`: ADD(-S) recall with 95 % interval of each cell, and `lost`.

    `lost` divides the misses among the stages. Stage 1 lost what the true region gains, stage 2
    what the true coarse pose gains in addition, and stage 3 the rest. The true coarse pose is the
    only hypothesis, so a wrong choice among hypotheses counts as a loss of stage 2.
    """

    def recall(some: Sequence[TargetScore]) -> dict[str, Any]:
        found = with_interval(some, METRICS["add"], evaluation.bootstrap, seed)
        return {"targets": len(some), **found}

    cells: list[dict[str, Any]] = []
    for (region, coarse), found in scores.items():
        per_object = {name: recall(group) for name, group in by_object(found, names).items()}
        of_all = {"region": region, "coarse": coarse, "add": recall(found)}
        cells.append({**of_all, "per_object": per_object})
    right = {(found["region"], found["coarse"]): found["add"]["recall"] for found in cells}
    lost = {
        "region": right["true", "estimated"] - right["estimated", "estimated"],
        "coarse pose": right["true", "true"] - right["true", "estimated"],
        "fine pose": 1.0 - right["true", "true"],
    }
    return {"cells": cells, "lost": lost}
