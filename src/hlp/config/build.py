"""Configuration → checked objects, before any stage runs. OmegaConf stops here."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_type_hints

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationToMissingValueError, MissingMandatoryValue
from pydantic import TypeAdapter, ValidationError

from hlp.codebook.inverted_lists import InvertedListsSettings, check_dimension
from hlp.codebook.neighbours import ExactSettings, KdForestSettings
from hlp.config.ranges import check_ranges
from hlp.config.settings import (
    BasinSettings,
    BenchSettings,
    EvaluateSettings,
    OracleSettings,
    RunSettings,
    SearchSettings,
)
from hlp.data.bop import BopSettings
from hlp.data.dataset import Dataset
from hlp.data.linemod import LinemodSettings
from hlp.data.loading import build_dataset
from hlp.data.own_frames import FilesSettings
from hlp.data.synthetic.scenes import SyntheticSettings
from hlp.evaluation.settings import EvaluationSettings
from hlp.method.settings import MachineSettings, PatchesSettings, TrainerSettings
from hlp.models import classifier, encoder
from hlp.models.autoencoder import AutoencoderSettings
from hlp.models.classifier import ClassifierSettings
from hlp.models.contrastive import ContrastiveSettings
from hlp.models.network import require_device
from hlp.models.pca import PcaSettings
from hlp.refinement.icp import IcpSettings
from hlp.refinement.none import NoneSettings
from hlp.refinement.pso import PsoSettings
from hlp.rendering.views import ViewsSettings
from hlp.reporting.tracking import TrackingSettings
from hlp.stages.executor import require
from hlp.stages.executor_settings import ClusterSettings, PoolSettings, SerialSettings
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
    _check_feature_size(settings)
    require(settings.executor)
    require_device(settings.machine.device)
    dataset = build_dataset(settings.data)
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
    _check_feature_size(settings)
    return settings


def with_changed_run(run: Run, changes: Mapping[str, Any]) -> Run:
    """A run on the same data set with some values changed; see `with_changes`."""
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


def _check_feature_size(settings: RunSettings) -> None:
    """What the search refuses is refused before anything is trained."""
    if isinstance(settings.codebook, InvertedListsSettings):
        encoder = settings.encoder
        most = 3 * encoder.cells**2 if isinstance(encoder, PcaSettings) else encoder.dimension
        check_dimension(min(encoder.dimension, most))


def evenly(keys: tuple[str, ...], count: int) -> tuple[str, ...]:
    """`count` of the keys, spread evenly. Raises ValueError below 1."""
    if count < 1:
        raise ValueError(f"frames is {count}: set a number of frames from 1, or null for all")
    if count >= len(keys):
        return keys
    return tuple(keys[i * len(keys) // count] for i in range(count))
