"""Settings: frozen records whose fields state their default, range and meaning.

    particles: Annotated[int, Ge(1), Doc("particles of the swarm (P: N)")] = 25

Ranges are those of `annotated_types`. They are checked whenever settings are made, also in Python.
`read_settings` makes settings from plain values, as in YAML or JSON. Not by pydantic: importing it
would take as long as NumPy, wherever an object is found.
"""

import dataclasses
import math
import numbers
import operator
import sys
import types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from os import PathLike
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from annotated_types import Ge, Gt, Interval
from typing_extensions import Doc as Doc

from hlp.errors import ConfigError, DataError
from hlp.registry import Registry

T = TypeVar("T")
Count = Annotated[int, Ge(1)]
NotNegative = Annotated[float, Ge(0)]
Positive = Annotated[float, Gt(0)]
Share = Annotated[float, Interval(ge=0, le=1)]
_MISSING = dataclasses.MISSING
_LONGEST = 60  # characters of a value or of a list of keys that a message shows
_PLAIN: dict[Any, tuple[Any, str]] = {
    bool: ((bool,), "true or false"),
    int: ((numbers.Integral,), "a whole number"),
    float: ((numbers.Real,), "a number"),
    str: ((str, PathLike), "text"),
    types.NoneType: ((types.NoneType,), "null"),
}
_KINDS = {*(words for _, words in _PLAIN.values()), "a list", "a mapping of keys to values"}
_BOUNDS = (
    ("ge", "at least", operator.ge),
    ("gt", "above", operator.gt),
    ("le", "at most", operator.le),
    ("lt", "below", operator.lt),
)
_UPPER = ("le", "lt")
_MOST = 1e6  # of a number whose field states no upper bound: no sound value comes near
_MOST_OF_UNITS = {"_deg": 360, "_mm": 1e5, "_cm": 1e4, "_px": 1e5}


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
            unit = next((unit for unit in _MOST_OF_UNITS if name.endswith(unit)), "")
            if mistake := _mistake(hint, getattr(self, name), _MOST_OF_UNITS.get(unit, _MOST)):
                problem = f"is {_shown(mistake.value)}: it must be {mistake.expected}"
                raise SettingsError(".".join((name, *mistake.place)), problem)


def read_settings(kind: type[T], values: Mapping[str, Any], key: str = "") -> T:
    """Settings of a class from plain values, nested as in YAML or JSON.

    Strict: "3" is not a number, and an unknown key is an error. Missing keys have the class's
    defaults. If a field's type names a registry, the value's `name` chooses the class. `key` is the
    path of the values, used in messages. Raises SettingsError.
    """
    return cast(T, _read_record(kind, values, key))


def stored_as(kind: type[T], content: Any, where: str) -> T:
    """A record that was stored as JSON; keys that it does not declare are left out.

    Raises DataError that begins with `where` and says what stood there and what is expected.
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


class _Mistake(NamedTuple):
    """What is wrong in a value: where in it, what stands there, and what must."""

    place: tuple[str, ...]
    value: Any
    expected: str


def _mistake(hint: Any, value: Any, most: float) -> _Mistake | None:
    """The first thing in a value that its type does not allow.

    `most` bounds the size of numbers whose type states no upper bound.
    """
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _bound_mistake(parts[0], parts[1:], value, most)
    if origin is Literal:
        return None if value in parts else _Mistake((), value, " or ".join(map(repr, parts)))
    if origin in (Union, types.UnionType):
        return _union_mistake(parts, value, most)
    if origin in (tuple, list):
        if not isinstance(value, tuple | list):
            return _Mistake((), value, "a list")
        kinds = _kinds_of_items(parts, len(value))
        if len(kinds) != len(value):
            return _Mistake((), value, f"a list of {len(kinds)}")
        return _first_within(zip(map(str, range(len(value))), kinds, value, strict=True), most)
    is_record = dataclasses.is_dataclass(hint) and not dataclasses.is_dataclass(value)
    if is_record or (origin is dict and not isinstance(value, Mapping)):
        return _Mistake((), value, "a mapping of keys to values")
    if origin is dict:
        return _first_within(((key, parts[1], inner) for key, inner in value.items()), most)
    return _plain_mistake(hint, value, most)


def _plain_mistake(hint: Any, value: Any, most: float) -> _Mistake | None:
    kinds, words = _PLAIN.get(hint, (object, ""))
    if not isinstance(value, kinds) or (isinstance(value, bool) and hint in (int, float, str)):
        return _Mistake((), value, words)
    if hint in (int, float) and not abs(value) < math.inf:
        return _Mistake((), value, "a finite number")
    if hint in (int, float) and abs(value) > most:
        return _Mistake((), value, f"at most {most:g}" if value > 0 else f"at least {-most:g}")
    return None


def _bound_mistake(bare: Any, facts: Sequence[Any], value: Any, most: float) -> _Mistake | None:
    """Of a type with bounds, which hold for a number, and not for the null that it may be too."""
    bounded = any(getattr(fact, bound, None) is not None for fact in facts for bound in _UPPER)
    if mistake := _mistake(bare, value, math.inf if bounded else most):
        return mistake
    for fact in facts:
        for bound, words, holds in _BOUNDS:
            limit = getattr(fact, bound, None)
            if isinstance(value, int | float) and limit is not None and not holds(value, limit):
                return _Mistake((), value, f"{words} {limit}")
    return None


def _union_mistake(parts: Sequence[Any], value: Any, most: float) -> _Mistake | None:
    """None if one of the parts allows the value; what is wrong within it goes before its kind."""
    mistakes = [_mistake(part, value, most) for part in parts]
    found = [mistake for mistake in mistakes if mistake is not None]
    if len(found) < len(mistakes):
        return None
    within = [mistake for mistake in found if mistake.place or mistake.expected not in _KINDS]
    if within:
        return within[0]
    return _Mistake((), value, " or ".join(mistake.expected for mistake in found))


def _first_within(items: Iterable[tuple[str, Any, Any]], most: float) -> _Mistake | None:
    """The first mistake of values inside another one, given their places and types."""
    for place, hint, value in items:
        if mistake := _mistake(hint, value, most):
            return mistake._replace(place=(str(place), *mistake.place))
    return None


def _kinds_of_items(parts: Sequence[Any], count: int) -> list[Any]:
    """The type of each of `count` items of a list or tuple; others if there must be others."""
    repeated = len(parts) == 1 or parts[1] is Ellipsis
    return [parts[0]] * count if repeated else list(parts)


def _read(hint: Any, value: Any, key: str) -> Any:
    """The value as its type has it; what does not fit stays, for the settings to complain of."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        registry = next((fact for fact in parts[1:] if isinstance(fact, Registry)), None)
        return _read(parts[0], value, key) if registry is None else _chosen(registry, value, key)
    if origin in (Union, types.UnionType):
        read = ((part, _read(part, value, key)) for part in parts)
        return next(
            (inner for part, inner in read if _mistake(part, inner, math.inf) is None), value
        )
    if origin in (tuple, list) and isinstance(value, tuple | list):
        kinds = _kinds_of_items(parts, len(value))
        places = (_join(key, str(i)) for i in range(len(value)))
        return (origin if len(kinds) == len(value) else list)(map(_read, kinds, value, places))
    if origin is dict and isinstance(value, Mapping):
        return {name: _read(parts[1], inner, _join(key, name)) for name, inner in value.items()}
    if dataclasses.is_dataclass(hint) and isinstance(value, Mapping):
        return _read_record(cast(type, hint), value, key)
    if hint is float and type(value) is int and abs(value) < sys.float_info.max:
        return float(value)
    return value


def _chosen(registry: Registry[Any], value: Any, key: str) -> Any:
    named = _mapping(value, key)
    if "name" not in named:
        raise _missing(_join(key, "name"))
    return _read_record(registry.find(str(named["name"]), key), named, key)


def _read_record(kind: type, value: Any, key: str) -> Any:
    given, hints = _mapping(value, key), _hints(cast(Any, kind))
    for name in given:
        if name not in hints:
            raise SettingsError(_join(key, name), f"is no key: {_instead(name, list(hints))}")
    for field in dataclasses.fields(kind):
        required = field.default is _MISSING and field.default_factory is _MISSING
        if required and field.name not in given:
            raise _missing(_join(key, field.name))
    read = {name: _read(hints[name], inner, _join(key, name)) for name, inner in given.items()}
    try:
        return kind(**read)
    except SettingsError as error:
        raise SettingsError(_join(key, error.key), error.problem) from error


def _mapping(value: Any, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise SettingsError(key, f"is {_shown(value)}: it must be a mapping of keys to values")
    return value


def _instead(name: str, known: list[str]) -> str:
    alike = get_close_matches(name, known, n=1, cutoff=0.7)
    return f"did you mean {alike[0]}?" if alike else f"there are {_cut(', '.join(known))}"


def _missing(key: str) -> SettingsError:
    return SettingsError(key, f"is not set: set {key}=VALUE")


def _shown(value: Any) -> str:
    return _cut(repr(value))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _join(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name
