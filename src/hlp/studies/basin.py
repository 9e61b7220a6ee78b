"""Basin map: from which errors of the coarse pose each refiner still reaches the true pose."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hlp.arrays import derive_seed, spread
from hlp.config.build import Run
from hlp.config.settings import TASKS
from hlp.evaluation.evaluator import add_correct
from hlp.geometry import rigid
from hlp.records import Frame, Hypotheses, parse_frame_key
from hlp.refinement.refiner import REFINERS, RefinementSettings
from hlp.refinement.verification import observe
from hlp.reporting.figures.heat_maps import draw_basins
from hlp.reporting.study_tables import basin_cells, format_basins, write_basins
from hlp.results.recalls import numbered_targets, write_target_values
from hlp.settings import Count, Doc, NotNegative, Settings, SettingsError
from hlp.stages.store import StageStore
from hlp.stages.trace_files import read_arrays
from hlp.studies.study_run import FrameCount, stage_of_frames, study_code, study_run

_PERTURBATIONS = 2  # number of the random stream


@TASKS.register
@dataclass(frozen=True)
class BasinSettings(Settings):
    """Config group `task`: ADD(-S) recall after each refiner, from poses with a given error."""

    name: Literal["basin"] = "basin"
    compared: Annotated[tuple[str, ...], Doc("names of the `refiners` that are compared (D)")] = (
        "pso",
        "icp",
        "none",
    )
    frames: FrameCount = 6
    rotation_deg: Annotated[
        tuple[NotNegative, ...],
        Doc("coarse poses are rotated about the centroid by these angles … (D)"),
    ] = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0)
    translation_mm: Annotated[
        tuple[NotNegative, ...], Doc("… and shifted by these distances, in random directions (D)")
    ] = (0.0, 10.0, 20.0, 40.0, 60.0)
    perturbations: Annotated[Count, Doc("random poses for each target and pair of errors (D)")] = 1
    refiners: Annotated[
        dict[str, Annotated[RefinementSettings, REFINERS]],
        Doc("refiners by name, as in conf/refinement"),
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise SettingsError naming the key of a list that cannot be worked with."""
        super().__post_init__()
        for refiner in self.compared:
            if refiner not in self.refiners:
                known = ", ".join(self.refiners)
                raise SettingsError("compared", f"names '{refiner}': choose of {known}")
        for key in ("compared", "rotation_deg", "translation_mm"):
            values = getattr(self, key)
            if not values or len(set(values)) < len(values):
                raise SettingsError(key, f"is {list(values)}: list each once, one at least")

    def run(self, run: Run, output: Path) -> None:
        """Refine the same perturbed poses with every refiner.

        Writes basin.md, basin.csv, targets.csv, heatmaps/, report.html and manifest.json. Nothing
        is learnt. The refined poses of each refiner are a stage, so an interrupted run continues
        where it stopped. Everything is logged as one MLflow run.
        """
        with study_run(run, output) as (store, _):
            keys = spread(run.keys, self.frames)
            folders = {name: _stage(run, self, name, keys, store) for name in self.compared}
            tried = {name: _score(run, self, keys, folder) for name, folder in folders.items()}
            cells = basin_cells(pd.concat(tried, names=["refiner"]).reset_index("refiner"))
            write_basins(output, cells)
            recalls = {
                name: found.groupby("target")["right"].mean().to_dict()
                for name, found in tried.items()
            }
            write_target_values(output, recalls, run.dataset.names)
            draw_basins(output / "heatmaps", cells)
        print(format_basins(cells))


def _stage(
    run: Run, task: BasinSettings, name: str, keys: Sequence[str], store: StageStore
) -> Path:
    """Folder with the poses refined by one refiner."""
    dataset = run.dataset
    decided = {
        "refinement": task.refiners[name],
        "rotation_deg": task.rotation_deg,
        "translation_mm": task.translation_mm,
        "perturbations": task.perturbations,
    }
    upstream = {"frames": dataset.frames_identity}
    upstream |= {f"model_{i}": dataset.model_identities[i] for i in dataset.target_ids}
    code = study_code(__name__, task.refiners[name], dataset.frames)
    find = partial(_refined, run, task, name)
    return stage_of_frames("basin", run, store, keys, find, code, decided, upstream, name)


def _refined(run: Run, task: BasinSettings, name: str, frame: Frame) -> dict[str, np.ndarray]:
    """Refined poses for the perturbed poses of one frame's targets, and the true poses.

    Arrays: `number/object/poses` (degrees, mm, perturbations, 4, 4), `number/object/truth` (4, 4).
    """
    arrays: dict[str, np.ndarray] = {}
    refiner = task.refiners[name].build(run.settings.machine.threads)
    seen = observe(frame.rgb, frame.depth, frame.camera_matrix, task.refiners[name].verification)
    for number, target in enumerate(frame.targets):
        model = run.dataset.models[target.object_id]
        parts = frame.scene_id, frame.frame_id, target.object_id, number, _PERTURBATIONS
        seed = derive_seed(run.settings.seed, *parts)
        perturbations = perturbation_grid(task, target.pose_cam_obj, model.centroid, seed)
        coarse = Hypotheses(perturbations.reshape(-1, 4, 4), np.ones(perturbations[..., 0, 0].size))
        refined = refiner.refine(model, seen, coarse, seed)
        poses = np.stack([found.pose_cam_obj for found in refined])
        key = f"{number}/{target.object_id}"
        arrays[f"{key}/poses"] = poses.reshape(perturbations.shape)
        arrays[f"{key}/truth"] = target.pose_cam_obj
    return arrays


def _score(run: Run, task: BasinSettings, keys: Sequence[str], folder: Path) -> pd.DataFrame:
    """A row for each pose of a refiner: target, object, starting errors, whether it is right."""
    errors = task.rotation_deg, task.translation_mm, range(task.perturbations)
    columns = ["rotation_deg", "translation_mm", "perturbation"]
    targets: list[tuple[int, int, int]] = []
    found = []
    for key in keys:
        stored = read_arrays(folder, key)
        named = [name.split("/") for name in stored if name.endswith("/poses")]
        for number, object_id, _ in sorted(named, key=lambda parts: int(parts[0])):
            poses, truth = (stored[f"{number}/{object_id}/{part}"] for part in ("poses", "truth"))
            model = run.dataset.models[int(object_id)]
            right = add_correct(poses.reshape(-1, 4, 4), truth, model, run.settings.evaluation)
            index = pd.MultiIndex.from_product(errors, names=columns)
            targets.append((*parse_frame_key(key), int(object_id)))
            found.append(pd.DataFrame({"object": model.name, "right": right}, index).reset_index())
    numbered = zip(numbered_targets(targets), found, strict=True)
    named_targets = sorted(numbered, key=lambda pair: pair[0][2])
    return pd.concat([rows.assign(target=[key] * len(rows)) for key, rows in named_targets])


def perturbation_grid(
    task: BasinSettings,
    pose_cam_obj: Float[np.ndarray, "4 4"],
    centroid: Float[np.ndarray, "3"],
    seed: int,
) -> Float[np.ndarray, "degrees millimetres perturbations 4 4"]:
    """`perturbations` poses for each pair of the errors in `rotation_deg` and `translation_mm`.

    They are rotated about the object's centroid (m, in object coordinates) and shifted. Each has
    its own axis and direction, drawn uniformly on the sphere; the sizes are exact.
    """
    sizes = task.rotation_deg, task.translation_mm, range(task.perturbations)
    degrees, millimetres, _ = np.meshgrid(*map(np.array, sizes), indexing="ij")
    drawn = np.random.default_rng(seed).normal(size=(2, degrees.size, 3))
    axes, directions = drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)
    turns = Rotation.from_rotvec(axes * np.deg2rad(degrees).reshape(-1, 1)).as_matrix()
    rotations = turns @ pose_cam_obj[:3, :3]
    middle = pose_cam_obj[:3, :3] @ centroid + pose_cam_obj[:3, 3]
    shifted = middle + directions * millimetres.reshape(-1, 1) / 1e3
    return rigid(rotations, shifted - rotations @ centroid).reshape(*degrees.shape, 4, 4)
