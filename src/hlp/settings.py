"""Settings, and records of JSON files: their fields state default, range and meaning.

    particles: Annotated[int, Ge(1), Doc("particles of the swarm (P: N)")] = 25

Ranges are those of `annotated_types`. They are checked whenever a record is made, also in Python.
`read_settings` makes settings from plain values, as in YAML, and `stored_as` what a JSON file
holds. Not by pydantic: importing it would take as long as NumPy, wherever an object is found.

Each group of alternatives has one `Registry`, in which a settings class registers itself:

    @REFINERS.register
    @dataclass(frozen=True)
    class PsoSettings(Settings):
        name: Literal["pso"] = "pso"

There is no list of the alternatives. A name is looked for in the modules of the group's package,
then in installed plug-ins, whose entry points are in the group `hlp.GROUP`.
"""

import dataclasses
import math
import pkgutil
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar, Union, cast, get_args, get_type_hints

from annotated_types import Ge, Gt, Interval
from typing_extensions import Doc as Doc

from hlp.errors import ConfigError, DataError, shortened
from hlp.files import read_json
from hlp.value_types import A_MAPPING, ValueType, kinds_of_items, mistake_in, type_of

T = TypeVar("T")
Kind = TypeVar("Kind", bound=type)


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
        if name not in self._known:
            for _ in self._imported(name):
                if name in self._known:
                    break
        if name not in self._known:
            known = ", ".join(sorted(self._known))
            raise ConfigError(f"{key or self.group}.name is '{name}': choose one of {known}")
        return self._known[name]

    def alternatives(self) -> dict[str, type[T]]:
        """All settings classes by name, including those of plug-ins. Imports all their modules."""
        for _ in self._imported(""):
            pass
        return dict(sorted(self._known.items()))

    def _imported(self, name: str) -> Iterator[None]:
        """Imports what may register the name, a module or plug-in a step, likely ones first."""
        package = import_module(self.package)
        found = [
            module.name for module in pkgutil.walk_packages(package.__path__, f"{self.package}.")
        ]
        for module in sorted(found, key=lambda module: name not in module.split(".")):
            import_module(module)
            yield
        from importlib.metadata import entry_points  # takes 20 ms and is rarely needed

        for plug_in in entry_points(group=f"hlp.{self.group}"):
            try:
                plug_in.load()
            except Exception as error:
                error.add_note(f"while loading the plug-in {plug_in.value} ({plug_in.group})")
                raise
            yield


def _path(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


Count = Annotated[int, Ge(1)]
NotNegative = Annotated[float, Ge(0)]
Positive = Annotated[float, Gt(0)]
Share = Annotated[float, Interval(ge=0, le=1)]
_MISSING = dataclasses.MISSING
_LONGEST = 60  # characters of a value or of a list of keys that a message shows
_MOST = 1e6  # of a number whose field states no upper bound: no sound value comes near
_MOST_OF_UNITS = {"_deg": 360, "_mm": 1e5, "_cm": 1e4, "_px": 1e5}


class SettingsError(ConfigError):
    """A wrong value in settings: its `key` and the `problem`."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(key, problem)
        self.key, self.problem = key, problem

    def __str__(self) -> str:
        return shortened(f"{self.key} {self.problem}")


@dataclass(frozen=True)
class Settings:
    """Base of all settings: checks types and ranges of its fields when it is made.

    Numbers must be finite. Those whose field states no upper bound are at most 1e6, angles (`_deg`)
    360, lengths 100 m.
    """

    def __post_init__(self) -> None:
        """Raise SettingsError naming the first field of a wrong type or out of range."""
        for name, kind in _fields(cast(Any, type(self))).items():
            unit = next((unit for unit in _MOST_OF_UNITS if name.endswith(unit)), "")
            if mistake := mistake_in(kind, getattr(self, name), _MOST_OF_UNITS.get(unit, _MOST)):
                problem = f"is {shown(mistake.value)}: it must be {mistake.expected}"
                raise SettingsError(".".join((name, *mistake.place)), problem)


class Stored(Settings):
    """Base of what a JSON file holds. Keys that are not declared are left out."""


@dataclass(frozen=True)
class ReadBy:
    """Annotates a type whose plain values are turned into others before they are checked."""

    convert: Callable[[Any], Any]


def read_settings(kind: type[T], values: Mapping[str, Any], key: str = "") -> T:
    """Settings of a class from plain values, nested as in YAML or JSON.

    Strict: "3" is not a number, and an unknown key is an error. Missing keys have the class's
    defaults. If a field's type names a registry, the value's `name` chooses the class. `key` is the
    path of the values, used in messages. Raises SettingsError.
    """
    return cast(T, _read_record(kind, values, key))


def stored_as(kind: type[T], content: Any, where: str) -> T:
    """The content of a JSON file as its type says: a `Stored` record, or a list or dict of them.

    Raises DataError that begins with `where` and says what stood there and what is expected.
    """
    whole = type_of(kind)
    try:
        value = _read(whole, content, "")
    except SettingsError as error:
        raise DataError(f"{where}: {error}") from error
    if mistake := mistake_in(whole, value, math.inf):
        key = ".".join(mistake.place) or "the content"
        raise DataError(f"{where}: {key} is {shown(mistake.value)}: it must be {mistake.expected}")
    return cast(T, value)


def read_as(path: Path, kind: type[T]) -> T:
    """A JSON file as its type says; see `read_json` and `stored_as` for what is raised."""
    return stored_as(kind, read_json(path), str(path))


def shown(value: Any) -> str:
    """A value as a message shows it."""
    return _cut("null" if value is None else repr(value))


def defaults_of(kind: type, name: str | None = None) -> dict[str, Any]:
    """Default values of a settings class as plain values; `???` (Hydra's mark) where it has none.

    `name` replaces the default name, for a class with several names.
    """
    plain: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        value = field.default
        if field.default_factory is not _MISSING:
            value = field.default_factory()
        if value is _MISSING:
            value = "???"
        plain[field.name] = dataclasses.asdict(value) if isinstance(value, Settings) else value
    return plain if name is None else {**plain, "name": name}


@cache
def _fields(kind: Any) -> dict[str, ValueType]:
    """Types of a settings class's fields."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: type_of(hints[field.name]) for field in dataclasses.fields(kind)}


def _read(kind: ValueType, value: Any, key: str) -> Any:
    """The value as its type has it; what does not fit stays, for the settings to complain of."""
    origin, parts = kind.origin, kind.parts
    for fact in kind.facts:
        if isinstance(fact, Registry):
            return _chosen(fact, value, key)
        if isinstance(fact, ReadBy):
            value = fact.convert(value)
    if origin is None:
        if kind.hint is float and type(value) is int and abs(value) < sys.float_info.max:
            return float(value)
        is_record = isinstance(value, Mapping) and dataclasses.is_dataclass(kind.hint)
        return _read_record(kind.hint, value, key) if is_record else value
    if origin is Union:
        for part in parts:
            inner = _read(part, value, key)
            if mistake_in(part, inner, math.inf) is None:
                return inner
    elif origin in (tuple, list) and isinstance(value, tuple | list):
        kinds = kinds_of_items(parts, len(value))
        places = (_join(key, str(i)) for i in range(len(value)))
        if len(kinds) == len(value):
            return origin(map(_read, kinds, value, places))
    elif origin is dict and isinstance(value, Mapping):
        return {name: _read(parts[1], inner, _join(key, name)) for name, inner in value.items()}
    return value


def _chosen(registry: Registry[Any], value: Any, key: str) -> Any:
    named = _mapping(value, key)
    if "name" not in named:
        raise _not_set(_join(key, "name"))
    return _read_record(registry.find(str(named["name"]), key), named, key)


def _read_record(kind: type, value: Any, key: str) -> Any:
    given, kinds = _mapping(value, key), _fields(kind)
    stored = issubclass(kind, Stored)
    if stored:
        given = {name: given[name] for name in kinds if name in given}
    for name in given:
        if name not in kinds:
            raise SettingsError(_join(key, name), f"is not a key: {_instead(name, list(kinds))}")
    for field in dataclasses.fields(kind):
        required = field.default is _MISSING and field.default_factory is _MISSING
        if required and field.name not in given:
            missing = _join(key, field.name)
            raise SettingsError(missing, "is missing") if stored else _not_set(missing)
    read = {name: _read(kinds[name], inner, _join(key, name)) for name, inner in given.items()}
    try:
        return kind(**read)
    except SettingsError as error:
        raise SettingsError(_join(key, error.key), error.problem) from error


def _mapping(value: Any, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise SettingsError(key, f"is {shown(value)}: it must be {A_MAPPING}")
    return value


def _instead(name: str, known: list[str]) -> str:
    alike = get_close_matches(name, known, n=1, cutoff=0.7)
    return f"did you mean {alike[0]}?" if alike else f"there are {_cut(', '.join(known))}"


def _not_set(key: str) -> SettingsError:
    return SettingsError(key, f"is not set: set {key}=VALUE")


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _join(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name
