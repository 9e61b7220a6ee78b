"""What Hydra composes a configuration of: the settings' defaults, and what the command line chose.

YAML files say only what differs. In every group, `base` holds the defaults of the group's settings
class. In a group of alternatives, `base_NAME` holds those of the class registered as NAME, also
from a plug-in:

    # conf/refinement/gentle.yaml
    defaults:
      - base_pso
      - _self_
    theta_deg: 5.0

An alternative that is nothing but these defaults has no file: it is a row of
`conf/alternatives.yaml`. The group `ladder` is rows of one file too.
"""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from hydra.conf import HydraConf
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.hydra_config import HydraConfig
from hydra.core.object_type import ObjectType
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, OmegaConf

from hlp.errors import ConfigError
from hlp.files import config_folder
from hlp.settings import Registry, Settings

_SCHEME = "hlp-defaults"
LADDER = "ladder"
"""The config group whose alternatives are rows of `conf/ladder.yaml`."""


def provide_defaults() -> None:
    """Let Hydra find the defaults, in this process and in those that launchers start."""
    for plugin in (TypedDefaults, TypedDefaultsPath):
        if plugin not in Plugins.instance().discover(plugin.__mro__[1]):
            Plugins.instance().register(plugin)


@cache
def group_kinds() -> dict[str, "type | Registry[Any]"]:
    """The settings class of each config group, or the registry of its alternatives."""
    from hlp.config.settings import RunSettings  # NumPy and OpenCV, half a second

    kinds: dict[str, type | Registry[Any]] = {}
    for name, hint in get_type_hints(RunSettings, include_extras=True).items():
        facts = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
        registries = [fact for fact in facts if isinstance(fact, Registry)]
        if registries:
            kinds[name] = registries[0]
        elif hasattr(hint, "__dataclass_fields__"):
            kinds[name] = hint
    return kinds


@cache
def rows() -> dict[str, dict[str, Any]]:
    """Alternatives without a file, by group and name: what each is, and the ladder's values."""
    paths = (config_folder() / f"{name}.yaml" for name in ("alternatives", LADDER))
    listed, ladder = (OmegaConf.to_container(OmegaConf.load(path)) for path in paths)
    assert isinstance(listed, dict) and isinstance(ladder, dict)
    return {**{str(group): dict(names) for group, names in listed.items()}, LADDER: dict(ladder)}


class TypedDefaults(ConfigSource):
    """The source from which Hydra reads what has no file: defaults, and rows of a file."""

    @staticmethod
    def scheme() -> str:
        """Scheme of this source in the search path."""
        return _SCHEME

    def load_config(self, config_path: str) -> ConfigResult:
        """The values as a configuration."""
        values = _values(config_path)
        assert values is not None, config_path
        header = {"package": "_global_" if config_path.startswith(f"{LADDER}/") else None}
        return ConfigResult(self.provider, self.full_path(), OmegaConf.create(values), header)

    def is_config(self, config_path: str) -> bool:
        """Whether the path is a group's `base` or `base_NAME`, or an alternative without a file."""
        return _values(config_path) is not None

    def is_group(self, config_path: str) -> bool:
        """Whether it is a group with rows, or what holds one."""
        return any(f"{group}/".startswith(_inside(config_path)) for group in rows())

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The rows of a group, and the groups in it; `base` is for other configurations."""
        inside = _inside(config_path)
        within = (group for group in rows() if group.startswith(inside))
        groups = {group.removeprefix(inside).partition("/")[0] for group in within}
        names = rows().get(config_path.strip("/"), {})
        found = {ObjectType.GROUP: groups, ObjectType.CONFIG: {*names}}
        return sorted(groups | {*names} if results_filter is None else found[results_filter])

    def available(self) -> bool:
        """Always."""
        return True


class TypedDefaultsPath(SearchPathPlugin):
    """Puts `TypedDefaults` on every search path."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append it last, so that a file of the same name has priority."""
        search_path.append("hlp", f"{_SCHEME}://")


def _inside(group: str) -> str:
    """How the paths of what is in a group begin."""
    return f"{group.strip('/')}/".lstrip("/")


def _values(config_path: str) -> dict[str, Any] | None:
    """The values at a path such as `refinement/base_pso` or `voting/joint`; None for no such."""
    group, _, file = config_path.removesuffix(".yaml").strip("/").rpartition("/")
    row = rows().get(group, {}).get(file)
    if group == LADDER:
        return row
    if "/" in group:  # a group within another one: its values are in the defaults already
        return None if row is None else {}
    name = file.removeprefix("base_")
    kind = group_kinds().get(group) if file == "base" or name != file or row else None
    if isinstance(kind, Registry):
        try:
            return defaults_of(kind.find(name), name)
        except ConfigError:
            return None
    if kind is None or name != file:
        return None
    return defaults_of(kind, None if file == "base" else name)


def defaults_of(kind: type, name: str | None = None) -> dict[str, Any]:
    """Default values of a settings class as plain values; `???` (Hydra's mark) where it has none.

    `name` replaces the default name, for a class with several names.
    """
    plain: dict[str, Any] = {}
    for one in dataclasses.fields(kind):
        value = one.default
        if one.default_factory is not dataclasses.MISSING:
            value = one.default_factory()
        if value is dataclasses.MISSING:
            value = "???"
        plain[one.name] = dataclasses.asdict(value) if isinstance(value, Settings) else value
    return plain if name is None else {**plain, "name": name}


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
