"""The settings' defaults as Hydra configurations, so that YAML files say only what differs.

In every group, `base` holds the defaults of the group's settings class; in a group of alternatives,
`base_NAME` those of the class that is registered as NAME, a plug-in's too:

    # conf/refinement/gentle.yaml
    defaults:
      - base_pso
      - _self_
    theta_deg: 5.0

They are no files and are not listed; a module is imported when one of its defaults is asked for.
"""

from typing import Annotated, Any, get_args, get_origin, get_type_hints

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from hlp.errors import ConfigError
from hlp.registry import Registry
from hlp.settings import defaults_of

_BASE = "base"
_SCHEME = "hlp-defaults"


def provide_defaults() -> None:
    """Let Hydra find the defaults, in this process and the launchers' that it starts."""
    for plugin in (TypedDefaults, TypedDefaultsPath):
        if plugin not in Plugins.instance().discover(plugin.__mro__[1]):
            Plugins.instance().register(plugin)


def group_kinds() -> dict[str, "type | Registry[Any]"]:
    """What each config group becomes: its settings class, or the registry of its alternatives."""
    from hlp.config.settings import RunSettings

    kinds: dict[str, type | Registry[Any]] = {}
    for name, hint in get_type_hints(RunSettings, include_extras=True).items():
        facts = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
        registries = [fact for fact in facts if isinstance(fact, Registry)]
        if registries:
            kinds[name] = registries[0]
        elif hasattr(hint, "__dataclass_fields__"):
            kinds[name] = hint
    return kinds


class TypedDefaults(ConfigSource):
    """Hydra's source of `GROUP/base` and `GROUP/base_NAME`."""

    @staticmethod
    def scheme() -> str:
        """What the search path calls it."""
        return _SCHEME

    def load_config(self, config_path: str) -> ConfigResult:
        """The defaults as a configuration."""
        found = _find(config_path)
        assert found is not None, config_path
        return ConfigResult(
            provider=self.provider,
            path=self.full_path(),
            config=OmegaConf.create(defaults_of(*found)),
            header={"package": None},
        )

    def is_config(self, config_path: str) -> bool:
        """Whether that is a group's `base` or `base_NAME`."""
        return _find(config_path) is not None

    def is_group(self, config_path: str) -> bool:
        """Whether it lists anything: never, groups are those of the files."""
        return False

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Nothing: defaults are for other configurations, not to be chosen."""
        return []

    def available(self) -> bool:
        """Always."""
        return True


class TypedDefaultsPath(SearchPathPlugin):
    """Puts `TypedDefaults` on every search path."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Last of all, so that a file of that name would win."""
        search_path.append("hlp", f"{_SCHEME}://")


def _find(config_path: str) -> tuple[type, str | None] | None:
    """The settings class of a path such as `refinement/base_pso`, and its name; None: no such."""
    group, _, file = config_path.removesuffix(".yaml").rpartition("/")
    base, _, name = file.partition("_")
    if base != _BASE or not group:
        return None
    kind = group_kinds().get(group)
    if isinstance(kind, Registry):
        try:
            return kind.find(name), name
        except ConfigError:
            return None
    return None if kind is None or name else (kind, None)
