"""What the command line chose: the overrides of a run, and the alternative of each group."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig

# Of the run itself rather than of what it does: keys, and groups with all that is in them.
_PLACES = re.compile(r"(output|work|experiment|data_folder)$|(hydra|reporting)\b")


@dataclass(frozen=True)
class Chosen:
    """Overrides by key, as text, and the alternative of each config group; empty from Python."""

    overrides: Mapping[str, str] = field(default_factory=dict)
    groups: Mapping[str, str] = field(default_factory=dict)
    command: str = ""


def chosen_by_hydra() -> Chosen:
    """What the run that Hydra has just composed was given."""
    hydra = HydraConfig.get()
    given = [str(override) for override in hydra.overrides.task]
    repeatable = (override for override in given if not override.startswith("output="))
    return Chosen(overrides_of(given), groups_of(hydra), " ".join(["hlp run", *repeatable]))


def overrides_of(given: Sequence[str]) -> dict[str, str]:
    """Overrides as text by key.

    Those that delete something or sweep are left out, and those that say where a run is stored.
    """
    return {
        override.key_or_group: str(override.get_value_element_as_str())
        for override in OverridesParser.create().parse_overrides([*given])
        if not override.is_delete()
        and not override.is_sweep_override()
        and not _PLACES.match(override.key_or_group)
    }


def groups_of(hydra: HydraConf | DictConfig) -> dict[str, str]:
    """The alternative of each of HLP's groups, from Hydra's own configuration."""
    return {
        str(group): str(name)
        for group, name in hydra.runtime.choices.items()
        if name and not str(group).startswith("hydra") and "@" not in str(group)
    }
