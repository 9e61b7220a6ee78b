"""Turns the configuration into checked objects. Code below this layer does not use OmegaConf.

Runs that differ from another in a few keys are made here too.
"""

import dataclasses
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue

from hlp.arrays import spread
from hlp.config.composition import Chosen
from hlp.config.settings import RunSettings
from hlp.data.dataset import Dataset, find_bad_frames
from hlp.errors import ConfigError, DataError
from hlp.evaluation import EvaluationSettings
from hlp.models.network import require_device
from hlp.reporting.summary_tables import ADD_BY_OBJECT
from hlp.settings import read_settings

_MOST = 8  # names that a message shows


@dataclass(frozen=True)
class Run:
    """Everything a run needs, checked: settings, data set, keys of its frames, configuration.

    `bad_frames` are those of its frames that cannot be used, with the reasons, as far as their
    files tell without being decoded. `chosen` is what the command line said.
    """

    settings: RunSettings
    dataset: Dataset
    keys: tuple[str, ...]
    config: dict[str, Any]
    bad_frames: Mapping[str, str] = field(default_factory=dict)
    chosen: Chosen = field(default_factory=Chosen)

    def require_sound_frames(self) -> None:
        """Raise DataError naming the first bad frame, if there is one."""
        for key, reason in self.bad_frames.items():
            raise DataError(f"frame {key}: {reason}")

    def require_some(self, failed: Mapping[str, str]) -> None:
        """Raise DataError if all frames have failed, for these reasons."""
        if len(failed) == len(self.keys):
            first = next(iter(failed.values()))
            raise DataError(f"none of the {len(failed)} frames can be used; the first: {first}")


def build_run(config: DictConfig, chosen: Chosen | None = None) -> Run:
    """Check the configuration and build what it names.

    Raises ConfigError naming a key that is unknown, missing or of the wrong type,
    FileNotFoundError naming a data folder, mesh or image list that is absent, and DataError if no
    frame can be used, or not all with `on_bad_frame=fail`.
    """
    settings = build_settings(config)
    settings.executor.require()
    require_device(settings.machine.device)
    dataset = settings.data.build()
    if settings.encoder.needs_frames:
        dataset.require_encoder_frames()
    check_symmetric(settings.evaluation, [model.name for model in dataset.models.values()])
    keys = dataset.frames.keys
    if not keys:
        raise ConfigError("data holds no frame with a target")
    keys = spread(keys, settings.frames)
    bad = find_bad_frames(dataset, keys)
    run = Run(settings, dataset, keys, _values(config), bad, chosen or Chosen())
    if settings.on_bad_frame == "fail":
        run.require_sound_frames()
    run.require_some(bad)
    return run


def with_changes(run: Run, changes: Mapping[str, Any]) -> RunSettings:
    """A run's settings with some values changed, nested as in the configuration.

    A mapping with a `name` replaces a whole group. Raises ConfigError naming the key that is wrong.
    """
    return build_settings(OmegaConf.create(_changed(run.config, changes)))


def with_changed_run(run: Run, changes: Mapping[str, Any]) -> Run:
    """A run on the same data set with some values changed; see `with_changes`."""
    settings = with_changes(run, changes)
    if settings.data != run.settings.data:
        raise ConfigError("data: the changed settings must keep the run's data set")
    return dataclasses.replace(run, settings=settings, config=_changed(run.config, changes))


# Not OmegaConf.merge: it would keep the keys of a group's other alternative.
def _changed(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    changed = dict(values)
    for key, change in changes.items():
        before = values.get(key)
        if isinstance(change, Mapping) and isinstance(before, Mapping) and "name" not in change:
            change = _changed(before, change)
        changed[key] = change
    return changed


def build_settings(config: DictConfig) -> RunSettings:
    """Typed settings of every group. Raises ConfigError naming the key that is wrong."""
    try:  # unresolved: what refers to a missing key is not missing itself
        OmegaConf.to_container(config, throw_on_missing=True)
    except MissingMandatoryValue as error:
        raise ConfigError(f"{error.full_key} is not set: set {error.full_key}=VALUE") from error
    return read_settings(RunSettings, _values(config))


def _values(config: DictConfig) -> dict[str, Any]:
    return cast(dict[str, Any], OmegaConf.to_container(config, resolve=True))


def check_symmetric(settings: EvaluationSettings, objects: Sequence[str]) -> None:
    """Compare the names with those of the data set's objects.

    A policy for LINEMOD names objects that a part of LINEMOD lacks; where it names none of the
    objects at all, as where they are numbered, a warning says so. Raises ConfigError for a name
    that is neither an object's nor one of LINEMOD's.
    """
    named = settings.symmetric or ()
    there = ", ".join(objects[:_MOST]) + (", …" if len(objects) > _MOST else "")
    numbered = [name for name in named if name.startswith("obj_") and name[4:].isdecimal()]
    unknown = [name for name in named if name not in {*objects, *ADD_BY_OBJECT, *numbered}]
    if unknown:
        raise ConfigError(
            f"evaluation.symmetric names {', '.join(unknown)}, which no object is called (objects: "
            f"{there})"
        )
    if named and not {*named} & {*objects}:
        logging.getLogger(__name__).warning(
            "evaluation.symmetric: no object is called %s (objects: %s), so none counts as "
            "symmetric; LINEMOD's by number: evaluation=bop_numbers, those of models_info.json: "
            "evaluation=symmetries",
            " or ".join(named),
            there,
        )
