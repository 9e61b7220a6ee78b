"""What the command line chose: the overrides of a run, and the file of each group."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig

# Of the run itself rather than of what it does: keys, and groups with all that is in them.
_PLACES = ("output", "work", "experiment", "data_folder")
_PLACE_GROUPS = re.compile(r"(hydra|reporting)\b")


@dataclass(frozen=True)
class Chosen:
    """Overrides by key, as text, and the alternative of each config group; empty from Python."""

    overrides: Mapping[str, str] = field(default_factory=dict)
    groups: Mapping[str, str] = field(default_factory=dict)
    command: str = ""


def chosen_by_hydra() -> Chosen:
    """What the run that Hydra has just composed was given."""
    hydra = HydraConfig.get()
    given = [str(each) for each in hydra.overrides.task]
    return Chosen(
        overrides_of(given),
        groups_of(hydra),
        " ".join(["hlp run", *(each for each in given if not each.startswith("output="))]),
    )


def overrides_of(given: Sequence[str]) -> dict[str, str]:
    """Overrides as text by key.

    Those that delete something or sweep are left out, and those that say where a run is stored.
    """
    parsed = OverridesParser.create().parse_overrides([*given])
    plain = (each for each in parsed if not each.is_delete() and not each.is_sweep_override())
    values = {each.key_or_group: str(each.get_value_element_as_str()) for each in plain}
    return {
        key: value
        for key, value in values.items()
        if key not in _PLACES and not _PLACE_GROUPS.match(key)
    }


def groups_of(hydra: HydraConf | DictConfig) -> dict[str, str]:
    """The alternative of each of HLP's groups, from Hydra's own configuration."""
    chosen = {str(group): name for group, name in hydra.runtime.choices.items() if name}
    return {
        group: str(name)
        for group, name in chosen.items()
        if not group.startswith("hydra") and "@" not in group
    }
