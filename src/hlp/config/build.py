"""Configuration → checked objects, before any stage runs. OmegaConf stops here."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_type_hints

import torch
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationToMissingValueError, MissingMandatoryValue
from pydantic import TypeAdapter, ValidationError

from hlp.codebook.inverted_lists import InvertedListsSettings
from hlp.codebook.neighbours import ExactSettings, KdForestSettings
from hlp.config.ranges import check_ranges
from hlp.config.settings import (
    BasinSettings,
    BenchSettings,
    ClusterSettings,
    EvaluateSettings,
    MachineSettings,
    OracleSettings,
    PatchesSettings,
    PoolSettings,
    RunSettings,
    SearchSettings,
    SerialSettings,
    TrainerSettings,
)
from hlp.data import bop_models, linemod, own_frames
from hlp.data.bop import BopFrames, BopSettings
from hlp.data.dataset import Dataset
from hlp.data.linemod import LinemodFrames, LinemodSettings
from hlp.data.own_frames import FilesSettings, OwnFrames
from hlp.data.photographs import list_photographs
from hlp.data.rgbd_frames import RgbdFrames
from hlp.data.sources import FrameSource
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings, training_frames
from hlp.evaluation.settings import EvaluationSettings
from hlp.models import classifier, encoder
from hlp.models.autoencoder import AutoencoderSettings
from hlp.models.classifier import ClassifierSettings
from hlp.models.contrastive import ContrastiveSettings
from hlp.models.pca import PcaSettings
from hlp.refinement.icp import IcpSettings
from hlp.refinement.none import NoneSettings
from hlp.refinement.pso import PsoSettings
from hlp.rendering.views import ViewsSettings
from hlp.reporting.tracking import TrackingSettings
from hlp.stages.executor import require
from hlp.voting.modes import JointVotingSettings, PaperVotingSettings

# Settings of each group: one class for all its files, or one for each `name`.
GROUPS: dict[str, type | dict[str, type]] = {
    "data": {
        "synthetic": SyntheticSettings,
        "bop": BopSettings,
        "linemod": LinemodSettings,
        "files": FilesSettings,
    },
    "rendering": ViewsSettings,
    "patches": PatchesSettings,
    "classifier": ClassifierSettings,
    "encoder": {
        "contrastive": ContrastiveSettings,
        "cae": AutoencoderSettings,
        "pca": PcaSettings,
    },
    "codebook": {
        "exact": ExactSettings,
        "kd_forest": KdForestSettings,
        "inverted_lists": InvertedListsSettings,
    },
    "voting": {"joint": JointVotingSettings, "paper": PaperVotingSettings},
    "refinement": {"pso": PsoSettings, "icp": IcpSettings, "none": NoneSettings},
    "evaluation": EvaluationSettings,
    "reporting": TrackingSettings,
    "trainer": TrainerSettings,
    "machine": MachineSettings,
    "executor": {
        "serial": SerialSettings,
        "loky": PoolSettings,
        "threading": PoolSettings,
        "dask": ClusterSettings,
        "ray": ClusterSettings,
    },
    "task": {
        "evaluate": EvaluateSettings,
        "oracle": OracleSettings,
        "basin": BasinSettings,
        "bench": BenchSettings,
        "search": SearchSettings,
    },
}
_BACKGROUND_FRAMES = 40
_BACKGROUND_SEED = 1_000_000  # far from the seeds of scenes with targets


@dataclass(frozen=True)
class Run:
    """Everything a run needs, checked: settings, dataset, the frames to look at, and the config."""

    settings: RunSettings
    dataset: Dataset
    keys: tuple[str, ...]
    config: dict[str, Any]


def build_run(config: DictConfig) -> Run:
    """Check the configuration and build what it names.

    Raises ValueError naming a key that is unknown, missing or of the wrong type, and
    FileNotFoundError naming a data folder, mesh or image list that is absent.
    """
    settings = build_settings(config)
    check_ranges(settings)
    _check_patch_sizes(settings)
    require(settings.executor)
    if settings.machine.device == "cuda" and not torch.cuda.is_available():
        raise ValueError("machine.device is cuda: torch sees no such GPU here; set it to cpu")
    dataset = build_dataset(settings)
    if isinstance(settings.encoder, AutoencoderSettings):
        dataset.require_encoder_frames()
    keys = dataset.frames.keys
    if not keys:
        raise ValueError("data holds no frame with a target")
    if settings.frames is not None:
        keys = evenly(keys, settings.frames)
    plain = OmegaConf.to_container(config, resolve=True)
    assert isinstance(plain, dict)
    return Run(settings, dataset, keys, {str(key): value for key, value in plain.items()})


def with_changes(run: Run, changes: Mapping[str, Any]) -> RunSettings:
    """A run's settings with some values changed, nested as in the configuration.

    A mapping with a `name` replaces a whole group. Raises ValueError naming the key that is wrong.
    """
    settings = build_settings(OmegaConf.create(_changed(run.config, changes)))
    check_ranges(settings)
    _check_patch_sizes(settings)
    return settings


def with_changed_run(run: Run, changes: Mapping[str, Any]) -> Run:
    """A run on the same dataset with some values changed, as `with_changes` does; raises what it raises."""
    settings = with_changes(run, changes)
    if settings.data != run.settings.data:
        raise ValueError("data: what is varied runs on one and the same dataset")
    return dataclasses.replace(run, settings=settings, config=_changed(run.config, changes))


def _changed(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    changed = dict(values)
    for key, change in changes.items():
        before = values.get(key)
        if isinstance(change, Mapping) and isinstance(before, Mapping) and "name" not in change:
            change = _changed(before, change)
        changed[key] = change
    return changed


def build_settings(config: DictConfig) -> RunSettings:
    """Typed settings of every group. Raises ValueError naming the key that is wrong."""
    kinds = get_type_hints(RunSettings)
    for name in [*config, *kinds]:
        if name not in kinds:
            raise ValueError(
                f"{name} is no key of the configuration: `hlp run --cfg job` lists all"
            )
        if name not in config or OmegaConf.is_missing(config, name):
            raise ValueError(f"{name} is not set: set {name}=VALUE")
    groups = {name: build_group(name, config[name]) for name in GROUPS}
    own = [name for name in kinds if name not in groups]
    plain = OmegaConf.to_container(OmegaConf.masked_copy(config, own), resolve=True)
    assert isinstance(plain, dict)
    others = {name: _typed(kinds[name], plain[name], name) for name in own}
    return RunSettings(**others, **groups)


def build_group(group: str, node: DictConfig) -> Any:
    """One group's settings as its dataclass. Raises ValueError naming the key that is wrong."""
    kinds = GROUPS[group]
    name = str(node.get("name"))
    if isinstance(kinds, dict) and name not in kinds:
        known = ", ".join(kinds)
        raise ValueError(f"{group}.name is '{name}': choose one of {known}")
    kind = kinds[name] if isinstance(kinds, dict) else kinds
    try:
        values = OmegaConf.to_container(node, resolve=True, throw_on_missing=True)
    except (MissingMandatoryValue, InterpolationToMissingValueError) as error:
        key = error.full_key or group
        raise ValueError(f"{key} is not set: set {key}=VALUE") from error
    assert isinstance(values, dict)
    if name != "None" and "name" not in {each.name for each in dataclasses.fields(kind)}:
        values.pop("name")
    return _typed(kind, values, group)


def _typed(kind: Any, values: Any, key: str) -> Any:
    """Check values against a type, strictly: "3" is no number, an unknown key is an error.

    By way of JSON, whose arrays may become tuples: settings are read-only.
    """
    try:
        return TypeAdapter(kind).validate_json(json.dumps(values), strict=True, extra="forbid")
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join([key, *(str(part) for part in first["loc"])])
        problem = first["msg"].removeprefix("Value error, ")
        if first["type"] == "value_error":  # by the settings themselves, in their own words
            raise ValueError(problem if key in problem else f"{where}: {problem}") from error
        given = "" if first["type"] == "missing" else f" (given: {first['input']!r})"
        raise ValueError(f"{where}: {problem}{given}") from error


def _check_patch_sizes(settings: RunSettings) -> None:
    """The networks' input sizes are fixed: the paper's."""
    patches = settings.patches
    for key, given, taken in (
        ("patches.holistic.resolution", patches.holistic.resolution, classifier.RESOLUTION),
        ("patches.local.resolution", patches.local.resolution, encoder.RESOLUTION),
    ):
        if given != taken:
            raise ValueError(f"{key} is {given}: the networks take {taken}")


def build_dataset(settings: RunSettings) -> Dataset:
    """Objects and frames of the configured data set; reads meshes, decodes no image."""
    data = settings.data
    if isinstance(data, SyntheticSettings):
        background = training_frames(data, _BACKGROUND_FRAMES, data.seed + _BACKGROUND_SEED)
        models = demo_objects()
        frames = SyntheticScenes(data)
        return Dataset(models, tuple(models), frames, None, background, background)
    if not isinstance(data, FilesSettings) and not Path(data.root).is_dir():
        raise FileNotFoundError(f"data.root is no folder: {data.root} (set data.root=PATH)")
    photographs = _folder("data.photographs", data.photographs)
    if photographs is not None:
        list_photographs(photographs)
    rooms = _rgbd("data.rooms", data.rooms)
    scenes = _rgbd("data.rgbd_frames", data.rgbd_frames)
    if isinstance(data, FilesSettings):
        model = own_frames.load_object_model(data)
        given = OwnFrames(Path(data.rgb), Path(data.depth), data.intrinsics, data.depth_scale)
        objects = {model.object_id: model}
        return Dataset(objects, tuple(objects), given, photographs, rooms, scenes, annotated=False)
    root = Path(data.root)
    if isinstance(data, LinemodSettings):
        models = linemod.load_object_models(root, data.objects, data.proxy_faces, data.mesh_scale)
        ids = {name: each.id for name, each in data.objects.items()}
        own = LinemodFrames(root, ids, data.camera_matrix)
        return Dataset(models, tuple(models), own, photographs, rooms, scenes)
    models = bop_models.load_object_models(
        root, data.objects, data.proxy_faces, data.symmetry_steps
    )
    if not (root / data.split).is_dir():
        raise FileNotFoundError(f"data.split is no folder: {root / data.split} (set data.split)")
    frames_bop = BopFrames(root, data.split, data.targets, models)
    wanted = {object_id for ids in frames_bop.targets.values() for object_id in ids}
    return Dataset(models, tuple(sorted(wanted)), frames_bop, photographs, rooms, scenes)


def _folder(key: str, path: str | None) -> Path | None:
    if path is None:
        return None
    if not Path(path).is_dir():
        raise FileNotFoundError(f"{key} is no folder: {path} (set {key}, or null for none)")
    return Path(path)


def _rgbd(key: str, path: str | None) -> FrameSource | None:
    folder = _folder(key, path)
    if folder is None:
        return None
    frames = RgbdFrames(folder)
    len(frames)  # lists the images: what is wrong with the folder is said now
    return frames


def evenly(keys: tuple[str, ...], count: int) -> tuple[str, ...]:
    """`count` of the keys, spread evenly. Raises ValueError below 1."""
    if count < 1:
        raise ValueError(f"frames is {count}: set a number of frames from 1, or null for all")
    if count >= len(keys):
        return keys
    return tuple(keys[i * len(keys) // count] for i in range(count))
