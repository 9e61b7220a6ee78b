"""Settings, and records of JSON files: their fields state default, range and meaning.

    particles: Annotated[int, Ge(1), Doc("particles of the swarm (P: N)")] = 25

Ranges are those of `annotated_types`. They are checked whenever a record is made, also in Python.
`read_settings` makes settings from plain values, as in YAML, and `stored_as` what a JSON file
holds. Not by pydantic: importing it would take as long as NumPy, wherever an object is found.
"""

import dataclasses
import math
import numbers
import operator
import sys
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from os import PathLike
from pathlib import Path
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

from annotated_types import Ge, Gt, Interval, Len
from typing_extensions import Doc as Doc

from hlp.errors import ConfigError, DataError, shortened
from hlp.files import read_json
from hlp.registry import Named as Named
from hlp.registry import Registry as Registry

T = TypeVar("T")

Count = Annotated[int, Ge(1)]
CountOrNone = Annotated[int | None, Ge(1)]
WholeNumber = Annotated[int, Ge(0)]
NotNegative = Annotated[float, Ge(0)]
Part = Annotated[float, Interval(gt=0, le=1)]
Positive = Annotated[float, Gt(0)]
PositiveOrNone = Annotated[float | None, Gt(0)]
Share = Annotated[float, Interval(ge=0, le=1)]
_MISSING = dataclasses.MISSING
_LONGEST = 60  # characters of a value or of a list of keys that a message shows
_MOST = 1e6  # of a number whose field states no upper bound: no sound value comes near
_MOST_OF_UNITS = {"_deg": 360, "_mm": 1e5, "_cm": 1e4, "_px": 1e5}
_PLAIN: dict[Any, tuple[Any, str]] = {
    bool: ((bool,), "true or false"),
    int: ((numbers.Integral,), "a whole number"),
    float: ((numbers.Real,), "a number"),
    str: ((str, PathLike), "text"),
    types.NoneType: ((types.NoneType,), "null"),
}
"""What stands for a value of a plain type, and what the type is called."""
_BOUNDS = (
    ("ge", "at least", operator.ge),
    ("gt", "above", operator.gt),
    ("le", "at most", operator.le),
    ("lt", "below", operator.lt),
)


class SettingsError(ConfigError):
    """A wrong value in settings: its `key` and the `problem`; the `kind` that its type demands."""

    def __init__(self, key: str, problem: str, kind: str = "") -> None:
        super().__init__(key, problem, kind)
        self.key, self.problem, self.kind = key, problem, kind

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
            limits = (most for unit, most in _MOST_OF_UNITS.items() if name.endswith(unit))
            _fitted(kind, getattr(self, name), name, next(limits, _MOST))


class Stored(Settings):
    """Base of what a JSON file holds. Keys that are not declared are left out."""


def read_settings(kind: type[T], values: Mapping[str, Any], key: str = "") -> T:
    """Settings of a class from plain values, nested as in YAML or JSON.

    Strict: "3" is not a number, and an unknown key is an error. Missing keys have the class's
    defaults. If a field's type names a registry, the value's `name` chooses the class. `key` is the
    path of the values, used in messages. Raises SettingsError.
    """
    record: Any = kind  # a dataclass, which its type does not say
    given, kinds = _mapping(values, key), _fields(record)
    stored = issubclass(kind, Stored)
    if stored:
        given = {name: given[name] for name in kinds if name in given}
    for name in given:
        if name not in kinds:
            alike = get_close_matches(str(name), kinds, n=1, cutoff=0.7)
            known = _cut(", ".join(kinds))
            instead = f"did you mean {alike[0]}?" if alike else f"there are {known}"
            raise SettingsError(_join(key, name), f"is not a key: {instead}")
    for field in dataclasses.fields(record):
        required = field.default is _MISSING and field.default_factory is _MISSING
        if required and field.name not in given:
            missing = _join(key, field.name)
            raise SettingsError(missing, "is missing") if stored else _not_set(missing)
    read = {name: _fitted(kinds[name], inner, _join(key, name)) for name, inner in given.items()}
    try:
        return kind(**read)
    except SettingsError as error:
        raise SettingsError(_join(key, error.key), error.problem) from error


def stored_as(kind: type[T], content: Any, where: str) -> T:
    """The content of a JSON file as its type says: a `Stored` record, or a list or dict of them.

    Raises DataError that begins with `where` and says what stood there and what is expected.
    """
    try:
        return cast(T, _fitted(_type_of(kind), content, ""))
    except SettingsError as error:
        raise DataError(f"{where}: {error.key or 'the content'} {error.problem}") from error


def read_as(path: Path, kind: type[T]) -> T:
    """A JSON file as its type says; see `read_json` and `stored_as` for what is raised."""
    return stored_as(kind, read_json(path), str(path))


def shown(value: Any) -> str:
    """A value as a message shows it."""
    return _cut("null" if value is None else repr(value))


class _Type(NamedTuple):
    """A type, taken apart once: what it is made of, and what its annotations say."""

    hint: Any
    origin: Any
    parts: tuple[Any, ...]
    facts: tuple[Any, ...] = ()
    bounds: tuple[tuple[str, Callable[[Any, Any], bool], Any], ...] = ()
    is_record: bool = False


def _type_of(hint: Any) -> _Type:
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        bare, facts = _type_of(parts[0]), parts[1:]
        bounds = (
            (f"{words} {bound}", holds, bound)
            for fact in facts
            for name, words, holds in _BOUNDS
            if (bound := getattr(fact, name, None)) is not None
        )
        for fact in facts:
            if isinstance(fact, Len):  # a list of that many
                bare = bare._replace(parts=bare.parts[:1] * fact.min_length)
        return bare._replace(facts=facts, bounds=tuple(bounds))
    if origin is not Literal:
        parts = tuple(part if part is Ellipsis else _type_of(part) for part in parts)
    return _Type(hint, origin, parts, is_record=dataclasses.is_dataclass(hint))


@cache
def _fields(kind: Any) -> dict[str, _Type]:
    """Types of a settings class's fields."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: _type_of(hints[field.name]) for field in dataclasses.fields(kind)}


def _fitted(kind: _Type, value: Any, key: str, most: float = math.inf) -> Any:
    """The value as its type has it. Raises SettingsError for one that the type does not allow.

    `most` bounds the size of numbers whose type states no upper bound. Bounds hold for a number,
    and not for the null that it may be too. A function among the annotations turns plain values
    into others first.
    """
    origin, parts = kind.origin, kind.parts
    if any(holds in (operator.le, operator.lt) for _, holds, _ in kind.bounds):
        most = math.inf
    for fact in kind.facts:
        if isinstance(fact, Registry):
            return value if dataclasses.is_dataclass(value) else _chosen(fact, value, key)
        if isinstance(fact, types.FunctionType):
            value = fact(value)
    fitted = value
    if kind.is_record:
        if not isinstance(value, kind.hint):
            fitted = read_settings(kind.hint, value, key)
    elif origin is None:
        fitted = _plain(kind.hint, value, key, most)
    elif origin is Literal and value not in parts:
        raise _wrong(key, value, " or ".join(map(repr, parts)))
    elif origin in (Union, types.UnionType):
        fitted = _one_of(parts, value, key, most)
    elif origin is dict:
        items = _mapping(value, key).items()
        fitted = {name: _fitted(parts[1], item, _join(key, name), most) for name, item in items}
    elif origin in (tuple, list):
        fitted = origin(_items(parts, value, key, most))
    if kind.bounds and isinstance(fitted, int | float):
        for words, holds, bound in kind.bounds:
            if not holds(fitted, bound):
                raise _wrong(key, value, words)
    return fitted


def _items(parts: tuple[Any, ...], value: Any, key: str, most: float) -> list[Any]:
    if not isinstance(value, tuple | list):
        raise _wrong(key, value, "a list", is_kind=True)
    repeated = len(parts) == 1 or parts[1] is Ellipsis
    kinds = parts[:1] * len(value) if repeated else parts
    if len(kinds) != len(value):
        raise _wrong(key, value, f"a list of {len(kinds)}")
    places = enumerate(zip(kinds, value, strict=True))
    return [_fitted(kind, item, _join(key, str(place)), most) for place, (kind, item) in places]


def _plain(hint: Any, value: Any, key: str, most: float) -> Any:
    is_number = hint is int or hint is float
    if type(value) is not hint:  # mostly it is; lists of targets have thousands
        kinds, words = _PLAIN.get(hint, (object, ""))
        if not isinstance(value, kinds) or (is_number and isinstance(value, bool)):
            raise _wrong(key, value, words, is_kind=True)
    if not is_number:
        return value
    if not abs(value) <= sys.float_info.max:
        raise _wrong(key, value, "a finite number")
    if abs(value) > most:
        raise _wrong(key, value, f"at most {most:g}" if value > 0 else f"at least {-most:g}")
    return float(value) if hint is float and type(value) is int else value


def _one_of(parts: tuple[_Type, ...], value: Any, key: str, most: float) -> Any:
    """As the first type that allows it; what is wrong within a value goes before its kind."""
    problems = []
    for part in parts:
        try:
            return _fitted(part, value, key, most)
        except SettingsError as error:
            problems.append(error)
    for problem in problems:
        if problem.key != key or not problem.kind:
            raise problem
    raise _wrong(key, value, " or ".join(problem.kind for problem in problems), is_kind=True)


def _wrong(key: str, value: Any, expected: str, is_kind: bool = False) -> SettingsError:
    kind = expected if is_kind else ""
    return SettingsError(key, f"is {shown(value)}: it must be {expected}", kind)


def _chosen(registry: Registry[Any], value: Any, key: str) -> Any:
    named = _mapping(value, key)
    if "name" not in named:
        raise _not_set(_join(key, "name"))
    return read_settings(registry.find(str(named["name"]), key), named, key)


def _mapping(value: Any, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _wrong(key, value, "a mapping of keys to values", is_kind=True)
    return value


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _not_set(key: str) -> SettingsError:
    return SettingsError(key, f"is not set: set {key}=VALUE")


def _join(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name
