"""Settings: frozen records whose fields state their default, range and meaning.

    particles: Annotated[int, Ge(1), Doc("particles of the swarm (P: N)")] = 25

Ranges are those of `annotated_types`. They are checked whenever settings are made, also in Python.
`read_settings` makes settings from plain values, as in YAML or JSON.
"""

import dataclasses
import math
import types
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from typing_extensions import Doc

from hlp.errors import ConfigError, DataError
from hlp.ranges import EXPECTED, either, expected_kinds, fits, most_of, out_of_range
from hlp.registry import Registry

__all__ = ["Doc", "Settings", "SettingsError", "defaults_of", "read_settings", "stored_as"]

T = TypeVar("T")
_MISSING = dataclasses.MISSING
_MOST_INT = 10**300  # more is no floating point number
_LONGEST = 60  # characters of a value or of a list of keys that a message shows


class SettingsError(ConfigError):
    """A wrong value in settings: its `key` and the `problem`."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(key, problem)
        self.key, self.problem = key, problem

    def __str__(self) -> str:
        return f"{self.key} {self.problem}"


@dataclass(frozen=True)
class Settings:
    """Base of all settings: checks types and ranges of its fields when it is made.

    Numbers must be finite. Those whose field states no upper bound are at most 1e6, angles (`_deg`)
    360, lengths 100 m.
    """

    def __post_init__(self) -> None:
        """Raise SettingsError naming the first field of a wrong type or out of range."""
        for name, hint in _hints(cast(Any, type(self))).items():
            value = getattr(self, name)
            if not fits(hint, value):
                raise _wrong(name, value, expected_kinds(hint))
            for inner, problem in out_of_range(hint, value, most_of(name)):
                raise SettingsError(name, f"is {_shown(inner)}: it must be {problem}")


def read_settings(kind: type[T], values: Mapping[str, Any], key: str = "") -> T:
    """Settings of a class from plain values, nested as in YAML or JSON.

    Strict: "3" is not a number, and an unknown key is an error. Missing keys have the class's
    defaults. If a field's type names a registry, the value's `name` chooses the class. `key` is the
    path of the values, used in messages. Raises SettingsError.
    """
    return cast(T, _read(kind, values, key))


def stored_as(kind: type[T], content: Any, where: str) -> T:
    """A record that was stored as JSON; keys that it does not declare are left out.

    For files that are read wherever an object is found: pydantic takes 0.17 s to import. Raises
    DataError that begins with `where` and says what stood there and what is expected.
    """
    if not isinstance(content, Mapping):
        raise DataError(f"{where} holds {_shown(content)}: it must be an object {{…}}")
    names = [field.name for field in dataclasses.fields(cast(Any, kind))]
    if missing := [name for name in names if name not in content]:
        raise DataError(f"{where}: {missing[0]} is missing")
    try:
        return read_settings(kind, {name: content[name] for name in names})
    except SettingsError as error:
        raise DataError(f"{where}: {error}") from error


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
def _hints(kind: Any) -> dict[str, Any]:
    """Types of a settings class's fields, with their annotations."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


def _read(hint: Any, values: Any, key: str) -> Any:
    if get_origin(hint) is Annotated:
        bare, *facts = get_args(hint)
        registry = next((fact for fact in facts if isinstance(fact, Registry)), None)
        return _read(bare, values, key) if registry is None else _chosen(registry, values, key)
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any:
        return values
    if origin is Literal:
        if values in parts:
            return values
        raise _wrong(key, values, either(parts))
    if origin in (Union, types.UnionType):
        return _read_union(parts, values, key)
    if origin in (tuple, list):
        return _read_list(origin, parts, values, key)
    if origin is dict:
        named = _checked(dict, values, key)
        return {name: _read(parts[1], each, _join(key, name)) for name, each in named.items()}
    if dataclasses.is_dataclass(hint):
        return _read_record(cast(type, hint), values, key)
    return _checked(hint, values, key)


def _chosen(registry: Registry[Any], values: Any, key: str) -> Any:
    named = _checked(dict, values, key)
    if "name" not in named:
        raise _missing(_join(key, "name"))
    return _read_record(registry.find(str(named["name"]), key), named, key)


def _read_record(kind: type, values: Any, key: str) -> Any:
    given, hints = _checked(dict, values, key), _hints(kind)
    for name in given:
        if name not in hints:
            raise SettingsError(_join(key, name), f"is no key: {_instead(name, list(hints))}")
    required = (each for each in dataclasses.fields(kind) if each.name not in given)
    for field in required:
        if field.default is _MISSING and field.default_factory is _MISSING:
            raise _missing(_join(key, field.name))
    read = {name: _read(hints[name], value, _join(key, name)) for name, value in given.items()}
    try:
        return kind(**read)
    except SettingsError as error:
        raise SettingsError(_join(key, error.key), error.problem) from error


def _instead(name: str, known: list[str]) -> str:
    alike = get_close_matches(name, known, n=1, cutoff=0.7)
    return f"did you mean {alike[0]}?" if alike else f"there are {_cut(', '.join(known))}"


def _read_union(parts: tuple[Any, ...], values: Any, key: str) -> Any:
    if values is None and types.NoneType in parts:
        return None
    kinds = [part for part in parts if part is not types.NoneType]
    for kind in kinds[:-1]:
        try:
            return _read(kind, values, key)
        except SettingsError:
            continue
    return _read(kinds[-1], values, key)


def _read_list(origin: type, parts: tuple[Any, ...], values: Any, key: str) -> Any:
    given = _checked(list, values, key)
    repeated = len(parts) == 1 or parts[1] is Ellipsis
    if not repeated and len(given) != len(parts):
        raise _wrong(key, values, f"a list of {len(parts)}")
    kinds = [parts[0]] * len(given) if repeated else parts
    indexed = enumerate(zip(kinds, given, strict=True))
    return origin(_read(kind, each, _join(key, str(i))) for i, (kind, each) in indexed)


def _checked(kind: type, value: Any, key: str) -> Any:
    """The value, if it has that plain type; a whole number becomes a float where expected."""
    if kind is float and type(value) is int and abs(value) < _MOST_INT:
        return float(value)
    good = type(value) is kind and not (isinstance(value, float) and math.isnan(value))
    if kind in (dict, list):
        good = isinstance(value, Mapping if kind is dict else list | tuple)
    if not good:
        raise _wrong(key, value, EXPECTED[kind])
    return value


def _wrong(key: str, value: Any, expected: str) -> SettingsError:
    return SettingsError(key, f"is {_shown(value)}: it must be {expected}")


def _missing(key: str) -> SettingsError:
    return SettingsError(key, f"is not set: set {key}=VALUE")


def _shown(value: Any) -> str:
    return _cut(repr(value))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _join(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name
