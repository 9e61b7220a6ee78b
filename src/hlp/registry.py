"""Registries of alternatives: settings classes, found by the name that a configuration states.

A group of alternatives has one registry. A settings class puts itself there:

    @REFINERS.register
    @dataclass(frozen=True)
    class PsoSettings(Settings):
        name: Literal["pso"] = "pso"

Nothing lists the alternatives: a name is looked for among the modules of the group's package, then
among installed plug-ins, which name their module under the entry point group `hlp.GROUP`.
"""

import pkgutil
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Generic, TypeVar, get_args, get_type_hints

from hlp.errors import ConfigError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
Kind = TypeVar("Kind", bound=type)


class Registry(Generic[T]):
    """The alternatives of one config group, by name; `T` is the protocol that all of them fulfil.

    `group` is the config group, `package` the package whose modules register alternatives. Both
    are names, so that a registry imports nothing before it is asked.
    """

    def __init__(self, group: str, package: str) -> None:
        self.group = group
        self.package = package
        self._known: dict[str, type[T]] = {}

    def register(self, kind: Kind) -> Kind:
        """Make a settings class known under each name that its field `name` may have.

        A class decorator. Raises ConfigError where another class has that name.
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

        What is registered already comes first, then the package's modules, one named like the
        alternative before the others, then plug-ins. Raises ConfigError naming `key` (default: the
        group) and the names that there are.
        """
        for load in self._sources(name):
            if name in self._known:
                break
            load()
        if name not in self._known:
            known = ", ".join(sorted(self._known))
            raise ConfigError(f"{key or self.group}.name is '{name}': choose one of {known}")
        return self._known[name]

    def alternatives(self) -> dict[str, type[T]]:
        """All settings classes by name, those of plug-ins too; imports all their modules."""
        for source in self._sources(""):
            source()
        return dict(sorted(self._known.items()))

    def _sources(self, name: str) -> Iterator[Callable[[], object]]:
        """What may register the name, most likely first: imports of modules and of plug-ins."""
        package = import_module(self.package)
        found = [each.name for each in pkgutil.walk_packages(package.__path__, f"{self.package}.")]
        for module in sorted(found, key=lambda each: each.rpartition(".")[2] != name):
            yield partial(import_module, module)
        from importlib.metadata import entry_points  # a fiftieth of a second, rarely needed

        for entry in entry_points(group=f"hlp.{self.group}"):
            yield partial(_load, entry)


def _load(plug_in: "EntryPoint") -> None:
    try:
        plug_in.load()
    except Exception as error:
        error.add_note(f"while loading the plug-in {plug_in.value} ({plug_in.group})")
        raise


def _path(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
