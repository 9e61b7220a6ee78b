"""KEY=VALUE arguments of the commands that need no configuration, such as `learn` and `predict`.

Hydra takes a second to start and reads a comma as a sweep; these commands take file names.
"""

import dataclasses
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeVar, cast

from hlp.errors import InputError
from hlp.files import expanded
from hlp.settings import read_settings

if TYPE_CHECKING:
    from hlp.data.own_frames import SearchMasks

T = TypeVar("T")
_MOST_BRACKETS = 64  # of a value: lists of lists are read one within the other


def nearest(word: str, known: Iterable[str]) -> str:
    """`: did you mean …?` if one of the known words is near, else nothing."""
    close = get_close_matches(word, [*known], 1)
    return f": did you mean {close[0]}?" if close else ""


def split_arguments(arguments: Sequence[str]) -> dict[str, str]:
    """KEY=VALUE arguments as a mapping; a key may be given as `data.KEY`, as in configurations.

    Raises InputError for an argument of another form, or a key that is given twice.
    """
    given: dict[str, str] = {}
    for argument in arguments:
        key, _, value = argument.partition("=")
        if not key or not value:
            raise InputError(f"cannot use '{argument}': arguments have the form KEY=VALUE")
        key = key.removeprefix("data.")
        if key in given:
            raise InputError(f"{key} is given twice")
        given[key] = value
    return given


def check_known(given: Mapping[str, str], known: Sequence[str], command: str) -> None:
    """Raise InputError for the first key that a command does not take."""
    for key in given:
        if key not in known:
            hint = nearest(key, known) or ":"
            raise InputError(
                f"{key} is not a key of `hlp {command}`{hint} see `hlp {command} --help`"
            )


def need(given: Mapping[str, str], keys: Iterable[str], known: Sequence[str], command: str) -> None:
    """Raise InputError for the first of some keys that is absent, or the one that is near it."""
    for key in keys:
        if key not in given:
            typed = get_close_matches(key, [word for word in given if word not in known], 1)
            if typed:
                raise InputError(f"{typed[0]} is not a key of `hlp {command}`: did you mean {key}?")
            raise InputError(f"{key} is not set: give {key}=…, see `hlp {command} --help`")


def known_arguments(arguments: Sequence[str], known: Sequence[str], command: str) -> dict[str, str]:
    """KEY=VALUE arguments of a command that takes just these keys. Raises InputError."""
    given = split_arguments(arguments)
    check_known(given, known, command)
    return given


def is_true(given: Mapping[str, str], key: str, default: bool) -> bool:
    """The value of a switch, which is true or false. Raises InputError for anything else."""
    value = given.get(key, str(default).lower())
    if value not in ("true", "false"):
        raise InputError(f"{key}={value}: it is true or false")
    return value == "true"


def read_group(kind: type[T], given: Mapping[str, str], **fixed: Any) -> T:
    """Settings of a class from those arguments that are its fields. Raises SettingsError."""
    names = field_names(kind) - set(fixed)
    values = {key: plain_value(value) for key, value in given.items() if key in names}
    return read_settings(kind, values | fixed)


def field_names(*kinds: Any) -> set[str]:
    """The names of all fields of some settings classes."""
    return {field.name for kind in kinds for field in dataclasses.fields(kind)}


def plain_value(text: str) -> Any:
    """A number, list, true, false or null; anything else is text: a path, with ~ expanded."""
    text = text.strip()
    if text.count("[") > _MOST_BRACKETS:
        raise InputError(f"{text} has more [ than any value")
    if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    with suppress(ValueError):
        return json.loads(text)
    if re.fullmatch(r"[-+]?(\d+\.|\.\d+)([eE][-+]?\d+)?", text):  # .9 and 9., no JSON
        return float(text)
    if text.startswith("[") and text.endswith("]"):
        return [plain_value(part) for part in text[1:-1].split(",") if part.strip()]
    return str(expanded(text)) if text.startswith("~") else text


def text_list(text: str) -> list[str]:
    """Names or paths separated by commas, with or without brackets; one path may hold commas."""
    if (path := expanded(text)).exists():
        return [str(path)]
    return [str(value) for value in plain_value(text if text.startswith("[") else f"[{text}]")]


def names_of_objects(given: Mapping[str, str]) -> list[str] | None:
    """The names that `objects` gives; None without. Raises InputError for none."""
    names = text_list(given["objects"]) if "objects" in given else None
    if names == []:
        raise InputError("objects names none: leave it out to look for all of them")
    return names


def search_masks(given: Mapping[str, str]) -> "SearchMasks | None":
    """Where `mask` or `box` say that objects are; None without. Raises InputError."""
    from hlp.data.own_frames import SearchMasks  # OpenCV: not for what only shows settings

    if "mask" not in given and "box" not in given:
        return None
    if "mask" in given and "box" in given:
        raise InputError("mask and box: give one of them")
    if "mask" in given:
        return SearchMasks(masks=str(plain_value(given["mask"])))
    box = plain_value(given["box"] if "[" in given["box"] else f"[{given['box']}]")
    if len(box) != 4 or not all(type(side) in (int, float) and abs(side) < 1e9 for side in box):
        raise InputError(f"box={given['box']}: it must be [x,y,width,height] in pixels")
    return SearchMasks(box=cast("tuple[float, float, float, float]", tuple(map(float, box))))


def whole_number(given: Mapping[str, str], key: str, most: int = 1024) -> int | None:
    """A key's whole number, 0 to `most`; None without. Raises InputError for anything else."""
    if key not in given:
        return None
    value = plain_value(given[key])
    if type(value) is not int or not 0 <= value <= most:
        raise InputError(f"{key}={given[key]}: it must be a whole number, 0 to {most}")
    return value


def tracking_uri(work: str = "work") -> str:
    """Where MLflow's runs are: its own MLFLOW_TRACKING_URI, or the database in the folder."""
    return os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{work}/mlflow.db"
