"""What types and ranges the fields of settings allow, as `hlp.settings` checks them."""

import math
import numbers
import operator
import types
from collections.abc import Iterator
from os import PathLike
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import BaseMetadata, GroupedMetadata

EXPECTED = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    dict: "a mapping of keys to values",
    list: "a list",
}
_BOUNDS = (
    ("ge", "at least", operator.ge),
    ("gt", "above", operator.gt),
    ("le", "at most", operator.le),
    ("lt", "below", operator.lt),
)
_MOST = 1e6  # of a number whose field states no upper bound: no sound value comes near
_MOST_OF_UNITS = {"_deg": 360, "_mm": 1e5, "_cm": 1e4, "_px": 1e5}
_PLAIN: dict[Any, tuple[type, ...]] = {
    bool: (bool,),
    int: (numbers.Integral,),
    float: (numbers.Real,),
    str: (str, PathLike),
    types.NoneType: (types.NoneType,),
}


def most_of(name: str) -> float:
    """The largest size of a number in a field that states no upper bound itself."""
    unit = next((each for each in _MOST_OF_UNITS if name.endswith(each)), "")
    return _MOST_OF_UNITS.get(unit, _MOST)


def fits(hint: Any, value: Any) -> bool:
    """Whether a value has the plain type that is expected, if one is: also in Python."""
    if get_origin(hint) is Annotated:
        return fits(get_args(hint)[0], value)
    if get_origin(hint) in (Union, types.UnionType):
        return any(fits(part, value) for part in get_args(hint))
    if hint not in _PLAIN:
        return True
    return isinstance(value, _PLAIN[hint]) and (hint is bool or not isinstance(value, bool))


def expected_kinds(hint: Any) -> str:
    """What `fits` expects, in words."""
    if get_origin(hint) is Annotated:
        return expected_kinds(get_args(hint)[0])
    parts = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    names = {types.NoneType: "null", **EXPECTED}
    return " or ".join(names.get(get_origin(part) or part, "settings") for part in parts)


def out_of_range(hint: Any, value: Any, most: float) -> Iterator[tuple[Any, str]]:
    """Numbers and choices in a value that its type does not allow, and what they must be.

    `most` bounds the size of numbers whose type states no upper bound.
    """
    if get_origin(hint) is Annotated:
        bare, *facts = get_args(hint)
        if isinstance(value, int | float):
            for fact in _single(facts):
                problem = _problem(fact, value)
                if problem:
                    yield value, problem
                if any(getattr(fact, bound, None) is not None for bound in ("le", "lt")):
                    most = math.inf
        yield from out_of_range(bare, value, most)
    elif get_origin(hint) is Literal and value not in get_args(hint):
        yield value, either(get_args(hint))
    elif isinstance(value, tuple | list):
        parts = get_args(hint)
        repeated = len(parts) == 1 or parts[1:] == (Ellipsis,)
        for part, each in zip([parts[0]] * len(value) if repeated else parts, value, strict=False):
            yield from out_of_range(part, each, most)
    elif isinstance(value, dict) and len(get_args(hint)) == 2:
        for each in value.values():
            yield from out_of_range(get_args(hint)[1], each, most)
    elif isinstance(value, int | float) and get_origin(hint) in (Union, types.UnionType):
        for part in get_args(hint):
            yield from out_of_range(part, value, most)
    elif hint in (int, float) and isinstance(value, int | float):
        if not abs(value) < math.inf:
            yield value, "a finite number"
        elif abs(value) > most:
            yield value, f"at most {most:g}" if value > 0 else f"at least {-most:g}"


def _single(facts: list[Any]) -> Iterator[Any]:
    for fact in facts:
        yield from fact if isinstance(fact, GroupedMetadata) else (fact,)


def _problem(fact: Any, value: float) -> str:
    """The limit that a number violates, in words; empty if it holds. NaN violates every limit."""
    for bound, words, holds in _BOUNDS:
        limit = getattr(fact, bound, None) if isinstance(fact, BaseMetadata) else None
        if limit is not None and not holds(value, limit):
            return f"{words} {limit}"
    return ""


def either(choices: tuple[Any, ...]) -> str:
    """Choices in words."""
    return " or ".join(map(repr, choices))
