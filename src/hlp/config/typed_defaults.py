"""The settings' defaults as Hydra configurations, so that YAML files say only what differs.

In every group, `base` holds the defaults of the group's settings class. In a group of alternatives,
`base_NAME` holds those of the class registered as NAME, also from a plug-in:

    # conf/refinement/gentle.yaml
    defaults:
      - base_pso
      - _self_
    theta_deg: 5.0

They are not files and are not listed. A module is imported when one of its defaults is used, unless
an earlier process has kept it (`kept_defaults`).
"""

from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from hlp.config.kept_defaults import keep_defaults, kept_defaults
from hlp.errors import ConfigError
from hlp.files import config_folder
from hlp.registry import Registry
from hlp.settings import defaults_of

_BASE = "base"
_SCHEME = "hlp-defaults"
LADDER = "ladder"
"""The config group whose alternatives are rows of one file."""


def provide_defaults() -> None:
    """Let Hydra find the defaults, in this process and in those that launchers start."""
    for plugin in (TypedDefaults, TypedDefaultsPath):
        if plugin not in Plugins.instance().discover(plugin.__mro__[1]):
            Plugins.instance().register(plugin)


@cache
def group_kinds() -> dict[str, "type | Registry[Any]"]:
    """The settings class of each config group, or the registry of its alternatives."""
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
    """The source from which Hydra reads `GROUP/base`, `GROUP/base_NAME` and rows of the ladder."""

    @staticmethod
    def scheme() -> str:
        """Scheme of this source in the search path."""
        return _SCHEME

    def load_config(self, config_path: str) -> ConfigResult:
        """The defaults as a configuration."""
        path = config_path.removesuffix(".yaml")
        row = _ladder_row(path)
        defaults = _defaults(path) if row is None else row
        assert defaults is not None, config_path
        return ConfigResult(
            provider=self.provider,
            path=self.full_path(),
            config=OmegaConf.create(defaults),
            header={"package": None if row is None else "_global_"},
        )

    def is_config(self, config_path: str) -> bool:
        """Whether the path is a group's `base` or `base_NAME`, or a row of the ladder."""
        path = config_path.removesuffix(".yaml")
        return _ladder_row(path) is not None or _defaults(path) is not None

    def is_group(self, config_path: str) -> bool:
        """Whether it is the ladder, or what holds it; the other groups are those of the files."""
        return config_path.strip("/") in {"", LADDER}

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The rows of the ladder; defaults are for other configurations and are not choices."""
        groups = results_filter == ObjectType.GROUP
        if not config_path.strip("/"):
            return [LADDER] if groups else []
        return [] if groups else sorted(ladder_rows())

    def available(self) -> bool:
        """Always."""
        return True


@cache
def ladder_rows() -> dict[str, Any]:
    """The configurations of the group `ladder`, which are rows of one file: `conf/ladder.yaml`."""
    rows = OmegaConf.to_container(OmegaConf.load(config_folder() / f"{LADDER}.yaml"), resolve=False)
    assert isinstance(rows, dict)
    return {str(name): row for name, row in rows.items()}


def _ladder_row(path: str) -> dict[str, Any] | None:
    group, _, name = path.strip("/").rpartition("/")
    return ladder_rows().get(name) if group == LADDER else None


class TypedDefaultsPath(SearchPathPlugin):
    """Puts `TypedDefaults` on every search path."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append it last, so that a file of the same name has priority."""
        search_path.append("hlp", f"{_SCHEME}://")


def _defaults(config_path: str) -> dict[str, Any] | None:
    """The defaults at a path such as `refinement/base_pso`; None if there are none."""
    if config_path in kept_defaults():
        return kept_defaults()[config_path]
    found = _find(config_path)
    if found is None:
        return None
    defaults = defaults_of(*found)
    if found[0].__module__.partition(".")[0] == "hlp":  # a change of a plug-in would not be seen
        keep_defaults(config_path, defaults)
    return defaults


def _find(config_path: str) -> tuple[type, str | None] | None:
    """The settings class of such a path, and its name; None if unknown."""
    group, _, file = config_path.rpartition("/")
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
