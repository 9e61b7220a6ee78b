"""KEY=VALUE arguments of the commands that need no configuration, such as `learn` and `predict`.

Hydra takes a second to start and reads a comma as a sweep; these commands take file names.
"""

import dataclasses
import json
import logging
import re
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO, TypeVar

from hlp.commands import composing
from hlp.commands.nearest import nearest
from hlp.errors import HlpError, InputError, is_expected
from hlp.settings import read_settings

T = TypeVar("T")
_FRAMEWORKS = {"hydra", "omegaconf"}


def split_arguments(arguments: Sequence[str]) -> dict[str, str]:
    """KEY=VALUE arguments as a mapping; a key may be given as `data.KEY`, as in configurations.

    Raises InputError for an argument of another form, or a key that is given twice.
    """
    given: dict[str, str] = {}
    for argument in arguments:
        key, sign, value = argument.partition("=")
        if not key or not sign or not value:
            raise InputError(f"cannot use '{argument}': arguments have the form KEY=VALUE")
        key = key.removeprefix("data.")
        if key in given:
            raise InputError(f"{key} is given twice")
        given[key] = value
    return given


def read_group(kind: type[T], given: Mapping[str, str], **fixed: Any) -> T:
    """Settings of a class from those arguments that are its fields. Raises SettingsError."""
    fields = {field.name for field in dataclasses.fields(kind)} - set(fixed)  # type: ignore[arg-type]
    values = {key: plain_value(value) for key, value in given.items() if key in fields}
    return read_settings(kind, values | fixed)


def field_names(*kinds: type) -> set[str]:
    """The names of all fields of some settings classes."""
    return {field.name for kind in kinds for field in dataclasses.fields(kind)}


def of_single(
    given: Mapping[str, str], keys: Collection[str], names: Collection[str]
) -> dict[str, dict[str, str]]:
    """Arguments KEY.NAME=VALUE, by name, of those keys that may be given for single objects.

    Raises InputError for a name that is none of `names`.
    """
    found: dict[str, dict[str, str]] = {}
    for argument, value in given.items():
        key, dot, name = argument.partition(".")
        if not dot or key not in keys:
            continue
        if name not in names:
            raise InputError(f"{argument}: there is no object '{name}': {', '.join(names)}")
        found.setdefault(name, {})[key] = value
    return found


def plain_value(text: str) -> Any:
    """A number, list, true, false or null; anything else is text: a path, with ~ expanded."""
    text = text.strip()
    if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    try:
        return json.loads(text)
    except ValueError:
        if re.fullmatch(r"[-+]?(\d+\.|\.\d+)([eE][-+]?\d+)?", text):  # .9 and 9., no JSON
            return float(text)
    if text.startswith("[") and text.endswith("]"):
        return [plain_value(part) for part in text[1:-1].split(",") if part.strip()]
    return str(Path(text).expanduser()) if text.startswith("~") else text


def text_list(text: str) -> list[str]:
    """Names or paths separated by commas, with or without brackets; one path may hold commas."""
    if Path(text).expanduser().exists():
        return [str(Path(text).expanduser())]
    value = plain_value(text if text.startswith("[") else f"[{text}]")
    return [str(each) for each in value]


def names_of_objects(given: dict[str, str]) -> list[str] | None:
    """The names that `objects` gives, which is taken out; None without. InputError for none."""
    if "objects" not in given:
        return None
    names = text_list(given.pop("objects"))
    if not names:
        raise InputError("objects names none: leave it out to look for all of them")
    return names


def whole_number(given: Mapping[str, str], key: str, most: int = 1024) -> int | None:
    """A key's whole number, 0 to `most`; None without. Raises InputError for anything else."""
    if key not in given:
        return None
    value = plain_value(given[key])
    if type(value) is not int or not 0 <= value <= most:
        raise InputError(f"{key}={given[key]}: it must be a whole number, 0 to {most}")
    return value


def check_known(given: Mapping[str, str], known: Sequence[str], command: str) -> None:
    """Raise InputError for the first key that a command does not take."""
    for key in given:
        if key not in known:
            hint = nearest(key, known)
            raise InputError(
                f"{key} is no key of `hlp {command}`{hint or ':'} see `hlp {command} --help`"
            )


def check_mistyped(
    given: Mapping[str, str], known: Collection[str], needed: Sequence[str], command: str
) -> None:
    """Raise InputError for a key that is none, but near one that is needed and absent."""
    absent = [key for key in needed if key not in given]
    for key in given:
        hint = "" if key in known else nearest(key, absent)
        if hint:
            raise InputError(f"{key} is no key of `hlp {command}`{hint}")


def output_folder(given: Mapping[str, str], command: str) -> Path:
    """The folder of the results: `output`, or one with the time in its name."""
    if "output" in given:
        return Path(given["output"]).expanduser()
    return Path("outputs", command, time.strftime("%Y-%m-%d_%H-%M-%S"))


def call(task: Callable[[], None], messages: TextIO | None = None) -> None:
    """Do a task with its messages on the terminal and its expected errors as one line.

    Messages go to standard output, or another stream for a command that writes data there.
    """
    with _messages_on_terminal(sys.stdout if messages is None else messages):
        try:
            task()
        except Exception as error:
            expected = isinstance(error, HlpError) or is_expected(error)
            if not expected and type(error).__module__.partition(".")[0] not in _FRAMEWORKS:
                raise
            composing.fail(error)


@contextmanager
def _messages_on_terminal(stream: TextIO) -> Iterator[None]:
    logger = logging.getLogger("hlp")
    handler = logging.StreamHandler(stream)
    handler.setFormatter(logging.Formatter("%(message)s"))
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)
