"""Which values a type with annotations allows: `Annotated[int, Ge(1)]`, lists, unions, mappings."""

import dataclasses
import math
import numbers
import operator
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from annotated_types import Len

_PLAIN: dict[Any, tuple[Any, str]] = {
    bool: ((bool,), "true or false"),
    int: ((numbers.Integral,), "a whole number"),
    float: ((numbers.Real,), "a number"),
    str: ((str, PathLike), "text"),
    types.NoneType: ((types.NoneType,), "null"),
}
A_MAPPING = "a mapping of keys to values"
_KINDS = {*(words for _, words in _PLAIN.values()), "a list", A_MAPPING}
_BOUNDS = (
    ("ge", "at least", operator.ge),
    ("gt", "above", operator.gt),
    ("le", "at most", operator.le),
    ("lt", "below", operator.lt),
)


class ValueType(NamedTuple):
    """A type, taken apart once: what it is made of, and what its annotations say."""

    hint: Any
    origin: Any
    parts: tuple[Any, ...]
    facts: tuple[Any, ...] = ()
    bounds: tuple[tuple[str, Callable[[Any, Any], bool], Any], ...] = ()
    has_upper: bool = False


def type_of(hint: Any) -> ValueType:
    """A type taken apart."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        facts = parts[1:]
        limits = [(getattr(fact, limit[0], None), limit) for fact in facts for limit in _BOUNDS]
        bounds = [(bound, limit) for bound, limit in limits if bound is not None]
        bare = type_of(parts[0])
        for fact in facts:
            if isinstance(fact, Len):  # a list of that many
                bare = bare._replace(parts=bare.parts[:1] * fact.min_length)
        return bare._replace(
            facts=facts,
            bounds=tuple((f"{words} {bound}", holds, bound) for bound, (_, words, holds) in bounds),
            has_upper=any(name in ("le", "lt") for _, (name, _, _) in bounds),
        )
    if origin in (Union, types.UnionType):
        origin = Union
    if origin is not Literal:
        parts = tuple(part if part is Ellipsis else type_of(part) for part in parts)
    return ValueType(hint, origin, parts)


class Mistake(NamedTuple):
    """What is wrong in a value: where in it, what stands there, and what must."""

    place: tuple[str, ...]
    value: Any
    expected: str


def mistake_in(kind: ValueType, value: Any, most: float) -> Mistake | None:
    """The first thing in a value that its type does not allow.

    `most` bounds the size of numbers whose type states no upper bound. Bounds hold for a number,
    and not for the null that it may be too.
    """
    mistake = _kind_mistake(kind, value, math.inf if kind.has_upper else most)
    if mistake is None and kind.bounds and isinstance(value, int | float):
        for words, holds, bound in kind.bounds:
            if not holds(value, bound):
                return Mistake((), value, words)
    return mistake


def _kind_mistake(kind: ValueType, value: Any, most: float) -> Mistake | None:
    hint, origin, parts = kind.hint, kind.origin, kind.parts
    if origin is None:
        if dataclasses.is_dataclass(hint) and not dataclasses.is_dataclass(value):
            return Mistake((), value, A_MAPPING)
        return _plain_mistake(hint, value, most)
    if origin is Literal:
        return None if value in parts else Mistake((), value, " or ".join(map(repr, parts)))
    if origin is Union:
        return _union_mistake(parts, value, most)
    if origin is dict:
        if not isinstance(value, Mapping):
            return Mistake((), value, A_MAPPING)
        return _first_within(((key, parts[1], inner) for key, inner in value.items()), most)
    if origin in (tuple, list):
        if not isinstance(value, tuple | list):
            return Mistake((), value, "a list")
        kinds = kinds_of_items(parts, len(value))
        if len(kinds) != len(value):
            return Mistake((), value, f"a list of {len(kinds)}")
        return _first_within(zip(range(len(value)), kinds, value, strict=True), most)
    return None


def _plain_mistake(hint: Any, value: Any, most: float) -> Mistake | None:
    if type(value) is not hint:  # mostly it is; lists of targets have thousands
        kinds, words = _PLAIN.get(hint, (object, ""))
        if not isinstance(value, kinds) or (isinstance(value, bool) and hint in (int, float, str)):
            return Mistake((), value, words)
    if hint is not int and hint is not float:
        return None
    if not abs(value) < math.inf:
        return Mistake((), value, "a finite number")
    if abs(value) > most:
        return Mistake((), value, f"at most {most:g}" if value > 0 else f"at least {-most:g}")
    return None


def _union_mistake(parts: Sequence[ValueType], value: Any, most: float) -> Mistake | None:
    """None if one of the parts allows the value; what is wrong within it goes before its kind."""
    mistakes = [mistake_in(part, value, most) for part in parts]
    found = [mistake for mistake in mistakes if mistake is not None]
    if len(found) < len(mistakes):
        return None
    within = [mistake for mistake in found if mistake.place or mistake.expected not in _KINDS]
    if within:
        return within[0]
    return Mistake((), value, " or ".join(mistake.expected for mistake in found))


def _first_within(items: Iterable[tuple[Any, ValueType, Any]], most: float) -> Mistake | None:
    """The first mistake of values inside another one, given their places and types."""
    for place, kind, value in items:
        if mistake := mistake_in(kind, value, most):
            return mistake._replace(place=(str(place), *mistake.place))
    return None


def kinds_of_items(parts: Sequence[Any], count: int) -> list[ValueType]:
    """The type of each of `count` items of a list or tuple; others if there must be others."""
    repeated = len(parts) == 1 or parts[1] is Ellipsis
    return [parts[0]] * count if repeated else list(parts)
