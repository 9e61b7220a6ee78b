"""Basin map: from how far off the true pose each refiner finds back."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from tqdm import tqdm

from hlp.evaluation.evaluator import ad_correct
from hlp.pipeline.build import Run
from hlp.pipeline.detector import hash_seed
from hlp.pipeline.finding import VERSIONS
from hlp.pipeline.fingerprint import fingerprint
from hlp.pipeline.frame_files import read_arrays, write_arrays
from hlp.pipeline.instrument import frames_looked_at, instrument_run
from hlp.pipeline.refiners import make_refiner
from hlp.pipeline.settings import BasinSettings, result_settings
from hlp.pipeline.starts import starts_off
from hlp.pipeline.store import StageStore
from hlp.records import Frame, Hypotheses
from hlp.refinement.refiner import Refiner
from hlp.reporting.basin_maps import Basins, basin_metrics, draw_basins, format_basins, write_basins

VERSION = 1
Verdicts = Bool[np.ndarray, "n degrees millimetres"]
_STARTS = 2  # their stream of random numbers


def run(planned: Run, task: BasinSettings, output: Path) -> Basins:
    """Refine the same starts with every refiner; write basin.csv, heatmaps/ and manifest.json.

    Nothing is learnt. What a refiner makes of the starts is a stage, so an interrupted run goes on
    where it stopped. Everything is logged as one MLflow run. Returns the recalls.
    """
    with instrument_run(planned, output) as (store, tracker):
        keys = frames_looked_at(planned, task.frames)
        right = {
            name: _score(planned, keys, _stage(planned, task, name, keys, store))
            for name in task.compared
        }
        basins = Basins(task.rotation_deg, task.translation_mm, right)
        write_basins(output, basins)
        draw_basins(output / "heatmaps", basins)
        tracker.log_metrics(basin_metrics(basins))
    print(format_basins(basins))
    return basins


def _stage(
    planned: Run, task: BasinSettings, name: str, keys: Sequence[str], store: StageStore
) -> Path:
    """Folder with the poses that one refiner makes of all starts, one file a frame."""
    world, settings = planned.world, planned.settings
    decided = {
        "refinement": result_settings(task.refiners[name]),
        "poses_version": VERSIONS["poses"],
        "rotation_deg": task.rotation_deg,
        "translation_mm": task.translation_mm,
        "starts": task.starts,
        "keys": list(keys),
    }
    upstream = {"frames": world.frames_identity}
    upstream |= {f"model_{i}": world.model_identities[i] for i in world.target_ids}

    def make(folder: Path) -> None:
        refiner = make_refiner(replace(settings, refinement=task.refiners[name]))
        for key in tqdm(keys, desc=f"basin of {name}", unit="frame", disable=None):
            if not (folder / f"{key}.npz").exists():
                write_arrays(folder, key, _refined(planned, task, refiner, world.frames.load(key)))

    digest = fingerprint("basin", VERSION, settings.seed, decided, upstream)
    described = {"settings": decided, "upstream": upstream, "seed": settings.seed}
    return store.get_or_make("basin", digest, make, described, name)


def _refined(
    planned: Run, task: BasinSettings, refiner: Refiner, frame: Frame
) -> dict[str, np.ndarray]:
    """What a refiner makes of the starts of one frame's targets, and where these truly are.

    Arrays are `number/object/poses` (degrees, mm, starts, 4, 4) and `number/object/truth` (4, 4).
    """
    arrays: dict[str, np.ndarray] = {}
    for number, target in enumerate(frame.targets):
        model = planned.world.models[target.object_id]
        seed = hash_seed(
            planned.settings.seed, frame.scene_id, frame.frame_id, target.object_id, number, _STARTS
        )
        starts = grid_of_starts(task, target.pose_cam_obj, model.centroid, seed)
        coarse = Hypotheses(starts.reshape(-1, 4, 4), np.ones(starts[..., 0, 0].size))
        refined = refiner.refine(model, frame.depth, frame.camera_matrix, coarse, seed)
        poses = np.stack([each.pose_cam_obj for each in refined])
        name = f"{number}/{target.object_id}"
        arrays |= {
            f"{name}/poses": poses.reshape(starts.shape),
            f"{name}/truth": target.pose_cam_obj,
        }
    return arrays


def grid_of_starts(
    task: BasinSettings,
    pose_cam_obj: Float[np.ndarray, "4 4"],
    centroid: Float[np.ndarray, "3"],
    seed: int,
) -> Float[np.ndarray, "degrees millimetres starts 4 4"]:
    """`starts` poses for each pair of the errors in `rotation_deg` and `translation_mm`."""
    shape = (len(task.rotation_deg), len(task.translation_mm), task.starts)
    degrees = np.broadcast_to(np.array(task.rotation_deg)[:, None, None], shape)
    millimetres = np.broadcast_to(np.array(task.translation_mm)[:, None], shape)
    rng = np.random.default_rng(seed)
    starts = starts_off(pose_cam_obj, centroid, degrees.ravel(), millimetres.ravel(), rng)
    return starts.reshape(*shape, 4, 4)


def _score(planned: Run, keys: Sequence[str], folder: Path) -> dict[str, Verdicts]:
    """By object whether AD is right (targets and starts, degrees, mm), from what is on disk."""
    models, evaluation = planned.world.models, planned.settings.evaluation
    right: dict[int, list[Verdicts]] = {}
    for key in keys:
        stored = read_arrays(folder, key)
        for name in [each for each in stored if each.endswith("/poses")]:
            number, object_id, _ = name.split("/")
            poses, truth = stored[name], stored[f"{number}/{object_id}/truth"]
            model = models[int(object_id)]
            verdicts = ad_correct(poses.reshape(-1, 4, 4), truth, model, evaluation)
            found = verdicts.reshape(poses.shape[:3])
            right.setdefault(int(object_id), []).append(np.moveaxis(found, 2, 0))
    return {models[i].name: np.concatenate(right[i]) for i in sorted(right)}
