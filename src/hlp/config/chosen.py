"""What the command line chose: the overrides of a run, and the file of each group."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig

# Of the run itself rather than of what it does.
_PLACES = ("output=", "work=", "experiment=", "hydra")


@dataclass(frozen=True)
class Chosen:
    """Overrides by key, as text, and the alternative of each config group; empty from Python."""

    overrides: Mapping[str, str] = field(default_factory=dict)
    groups: Mapping[str, str] = field(default_factory=dict)
    command: str = ""


def chosen_by_hydra() -> Chosen:
    """What the run that Hydra has just composed was given, without where its results go."""
    hydra = HydraConfig.get()
    given = [str(each) for each in hydra.overrides.task]
    return Chosen(
        overrides_of([each for each in given if not each.startswith(_PLACES)]),
        groups_of(hydra),
        " ".join(["hlp run", *(each for each in given if not each.startswith("output="))]),
    )


def overrides_of(given: Sequence[str]) -> dict[str, str]:
    """Overrides as text by key; those that delete something or sweep are left out."""
    parsed = OverridesParser.create().parse_overrides([*given])
    plain = (each for each in parsed if not each.is_delete() and not each.is_sweep_override())
    return {each.key_or_group: str(each.get_value_element_as_str()) for each in plain}


def groups_of(hydra: HydraConf | DictConfig) -> dict[str, str]:
    """The alternative of each of HLP's groups, from Hydra's own configuration."""
    chosen = {str(group): name for group, name in hydra.runtime.choices.items() if name}
    return {
        group: str(name)
        for group, name in chosen.items()
        if not group.startswith("hydra") and "@" not in group
    }
