"""The alternatives of a config group: each settings class registers itself under its name.

    @REFINERS.register
    @dataclass(frozen=True)
    class PsoSettings(Settings):
        name: Literal["pso"] = "pso"

There is no list of the alternatives. A name is looked for in the modules of the group's package,
then in installed plug-ins, whose entry points are in the group `hlp.GROUP`.
"""

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from typing import Generic, Protocol, TypeVar, get_args, get_type_hints

from hlp.errors import ConfigError

T = TypeVar("T")
Kind = TypeVar("Kind", bound=type)


class Named(Protocol):
    """What the protocols of all groups ask for."""

    @property
    def name(self) -> str:
        """The alternative's name."""


class Registry(Generic[T]):
    """The alternatives of one config group, by name; `T` is the protocol that all of them fulfil.

    `group` is the config group, `package` the package whose modules register alternatives. Both
    are names, so a registry imports nothing until a name is looked for.
    """

    def __init__(self, group: str, package: str) -> None:
        self.group = group
        self.package = package
        self._known: dict[str, type[T]] = {}

    def register(self, kind: Kind) -> Kind:
        """Class decorator: register a settings class under each name that its field `name` allows.

        Raises ConfigError if another class has that name.
        """
        for name in get_args(get_type_hints(kind)["name"]):
            other = self._known.setdefault(name, kind)
            if _path(other) != _path(kind):
                raise ConfigError(
                    f"{self.group}: both {_path(other)} and {_path(kind)} are named '{name}'"
                )
            self._known[name] = kind
        return kind

    def find(self, name: str, key: str = "") -> type[T]:
        """The settings class of that name.

        It is looked for among the registered classes, then in the package's modules, first in one
        named like the alternative or in a package of that name, then in plug-ins. Raises
        ConfigError, which names `key` (default: the group) and the known names.
        """
        imported = self._imported(name)
        while name not in self._known:
            if next(imported, None) is None:
                known = ", ".join(sorted(self._known))
                raise ConfigError(f"{key or self.group}.name is '{name}': choose one of {known}")
        return self._known[name]

    def alternatives(self) -> dict[str, type[T]]:
        """All settings classes by name, including those of plug-ins. Imports all their modules."""
        list(self._imported(""))
        return dict(sorted(self._known.items()))

    def _imported(self, name: str) -> Iterator[str]:
        """Imports what may register the name, a module or plug-in a step, likely ones first."""
        package = import_module(self.package)
        found = pkgutil.walk_packages(package.__path__, f"{self.package}.")
        for module in sorted(found, key=lambda module: name not in module.name.split(".")):
            import_module(module.name)
            yield module.name
        from importlib.metadata import entry_points  # takes 20 ms and is rarely needed

        for plug_in in entry_points(group=f"hlp.{self.group}"):
            try:
                plug_in.load()
            except Exception as error:
                error.add_note(f"while loading the plug-in {plug_in.value} ({plug_in.group})")
                raise
            yield plug_in.name


def _path(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
