"""Tables of configuration keys, read from the typed settings: their fields say what may be set."""

import dataclasses
import inspect
import re
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from hlp.settings import Doc, Registry

UNITS = {"mm": "mm", "cm": "cm", "m": "m", "deg": "°", "px": "px", "ms": "ms", "seconds": "s"}
"""What the last part of a key says about its unit."""
_PLAIN = {int: "integer", float: "number", str: "text", bool: "true or false", Any: "any"}
_BOUNDS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}


@dataclass(frozen=True)
class Key:
    """One row of a table; empty where the settings say nothing."""

    name: str
    kind: str
    default: str
    unit: str
    range: str
    description: str


@dataclass(frozen=True)
class Table:
    """The keys of one settings class, below `prefix`; `intro` is the class's docstring."""

    title: str
    intro: str
    keys: tuple[Key, ...]


def tables_of(kind: type, prefix: str, defaults: Any = None) -> list[Table]:
    """Tables of a settings class and of those nested in it, outermost first.

    `defaults` is an instance whose values replace the class's own defaults. A nested class whose
    key is a mapping's value appears below `NAME`.
    """
    hints = get_type_hints(kind, include_extras=True)
    rows: list[Key] = []
    nested: list[Table] = []
    for field in dataclasses.fields(kind):
        if not field.init:
            continue
        facts = _facts(hints[field.name])
        default = _default(field, defaults)
        inner = list(settings_classes(hints[field.name]))
        if len(inner) == 1 and inner[0] is not kind:
            value = default if isinstance(default, inner[0]) else None
            named = ".NAME" if _is_mapping(hints[field.name]) else ""
            nested += tables_of(inner[0], f"{prefix}{field.name}{named}.", value)
            if not named and type(None) not in get_args(_bare(hints[field.name])):
                continue  # its own table says everything
        rows.append(
            Key(
                f"{prefix}{field.name}",
                kind_of(hints[field.name]),
                shown(default),
                unit_of(field.name),
                range_of(facts),
                description_of(facts),
            )
        )
    return [Table(kind.__name__, inspect.cleandoc(kind.__doc__ or ""), tuple(rows)), *nested]


def settings_classes(hint: Any) -> Iterator[type]:
    """The settings classes that a type is made of, in order."""
    facts = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    for fact in facts:
        if isinstance(fact, Registry):
            yield from dict.fromkeys(fact.alternatives().values())
            return
    bare = _bare(hint)
    if inspect.isclass(bare) and dataclasses.is_dataclass(bare):
        yield bare
        return
    for argument in get_args(bare):
        yield from settings_classes(argument)


def kind_of(hint: Any) -> str:
    """A type as somebody who writes YAML thinks of it."""
    bare = _bare(hint)
    if bare in _PLAIN:
        return _PLAIN[bare]
    if bare is type(None):
        return "null"
    origin, arguments = get_origin(bare), get_args(bare)
    if origin is Literal:
        return ", ".join(f"`{argument}`" for argument in arguments)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(kind_of(argument) for argument in arguments))
    if origin in (tuple, list):
        counted = [argument for argument in arguments if argument is not Ellipsis]
        if origin is tuple and Ellipsis not in arguments:
            return f"list of {len(counted)}: " + ", ".join(
                kind_of(argument) for argument in counted
            )
        return f"list of {kind_of(counted[0])}"
    if _is_mapping(bare):
        return f"mapping of {kind_of(arguments[0])} to {kind_of(arguments[1])}"
    return f"`{getattr(bare, '__name__', bare)}`"


def range_of(facts: list[Any]) -> str:
    """The bounds among a field's facts, e.g. `≥ 1, < 180`."""
    found: dict[str, str] = {}
    for fact in facts:
        for name, sign in _BOUNDS.items():
            bound = getattr(fact, name, None)
            if isinstance(bound, int | float):
                found[sign] = f"{sign} {bound:g}"
    return ", ".join(found.values())


def description_of(facts: list[Any]) -> str:
    """The description among a field's facts."""
    texts = (fact.documentation for fact in facts if isinstance(fact, Doc))
    return " ".join(next(texts, "").split())


def unit_of(key: str) -> str:
    """The unit that the ending of a key names."""
    return UNITS.get(key.rpartition("_")[2], "") if "_" in key else ""


def shown(default: Any) -> str:
    """A default as YAML has it; empty where a value must be given."""
    if default is dataclasses.MISSING:
        return ""
    if default is None:
        return "`null`"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, str):
        return f"`{default}`" if default else '`""'
    if isinstance(default, tuple | list):
        return f"`[{', '.join(shown(item).strip('`') for item in default)}]`"
    if isinstance(default, Mapping) or dataclasses.is_dataclass(default):
        return ""  # too long for a cell: its YAML file or its own table shows it
    return f"`{default}`"


def as_markdown(table: Table, heading: str) -> str:
    """A table with its heading and introduction; columns that say nothing are left out."""
    columns = {
        "Key": [f"`{key.name}`" for key in table.keys],
        "Type": [key.kind for key in table.keys],
        "Default": [key.default for key in table.keys],
        "Unit": [key.unit for key in table.keys],
        "Range": [key.range for key in table.keys],
        "Description": [key.description for key in table.keys],
    }
    used = {name: cells for name, cells in columns.items() if any(cells)}
    intro = re.sub(r"^Config group `\w+`: ", "", table.intro)
    lines = [heading, "", intro[:1].upper() + intro[1:], ""]
    if used:
        lines += [_row(used), _row({name: ["---"] for name in used}, 0)]
        lines += [_row(used, index) for index in range(len(table.keys))]
    return "\n".join([*lines, ""])


def _row(columns: Mapping[str, list[str]], index: int | None = None) -> str:
    cells = list(columns) if index is None else [cells[index] for cells in columns.values()]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _bare(hint: Any) -> Any:
    """A type without what `Annotated` and aliases add to it."""
    while get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    return hint


def _is_mapping(hint: Any) -> bool:
    origin = get_origin(_bare(hint))
    return inspect.isclass(origin) and issubclass(origin, Mapping)


def _facts(hint: Any) -> list[Any]:
    """What annotations say; those of a union's parts too."""
    found: list[Any] = []
    if get_origin(hint) is Annotated:
        found += get_args(hint)[1:]
    if get_origin(_bare(hint)) in (Union, types.UnionType):
        for part in get_args(_bare(hint)):
            if get_origin(part) is Annotated:
                found += get_args(part)[1:]
    return found


def _default(field: "dataclasses.Field[Any]", instance: Any) -> Any:
    if instance is not None:
        return getattr(instance, field.name)
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default
