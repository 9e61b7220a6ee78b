"""The one door for JSON from outside: bounded, checked, and errors that say what is expected.

Every message names the file, the key, what stood there and what is expected there.
"""

import json
from pathlib import Path
from typing import Any, TypeVar

from hlp.errors import DataError, MissingFileError
from hlp.settings import stored_as

T = TypeVar("T")

MOST_BYTES = 512 * 1024**2
"""A larger JSON file is an error: it would fill the memory. BOP's largest have 100 MB."""
_DEEPEST = 64  # lists and objects within each other


def read_text_json(path: Path, most_bytes: int = MOST_BYTES) -> Any:
    """Parsed JSON of a bounded file.

    Raises MissingFileError; DataError for a file that is too large, no JSON, not in UTF-8, nested
    too deeply, or that states a key twice.
    """
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}")
    try:
        if (size := path.stat().st_size) > most_bytes:
            raise DataError(f"{path} has {size} bytes: at most {most_bytes} are read")
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is no JSON: it is not in UTF-8 ({error.reason})") from error
    except PermissionError as error:
        raise DataError(f"{path} may not be read: give yourself the right to") from error
    return parse_json(text, str(path))


def parse_json(text: str, where: str) -> Any:
    """Parsed JSON of a text; see `read_text_json`."""
    try:
        content = json.loads(text, object_pairs_hook=_without_doubles)
    except RecursionError as error:
        raise _too_deep(where) from error
    except _DoubleKeyError as error:
        raise DataError(f"{where} states the key {error} twice: leave one out") from error
    except ValueError as error:
        raise DataError(f"{where} is no JSON: {error}") from error
    level: list[Any] = [content]
    for _ in range(_DEEPEST):
        level = [inner for outer in level for inner in _inner(outer)]
        if not level:
            return content
    raise _too_deep(where)


def read_as(path: Path, kind: type[T]) -> T:
    """JSON of a bounded file, as a schema describes it.

    Raises what `read_text_json` raises, and DataError for the first thing that is not as `kind`
    says.
    """
    return stored_as(kind, read_text_json(path), str(path))


class _DoubleKeyError(Exception):
    """A key is stated twice in one object."""


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise _DoubleKeyError(repr(next(name for name in names if names.count(name) > 1)))
    return found


def _inner(value: Any) -> list[Any]:
    """The lists and objects that a list or object holds."""
    held = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [inner for inner in held if isinstance(inner, dict | list)]


def _too_deep(where: str) -> DataError:
    return DataError(f"{where} is nested deeper than {_DEEPEST} levels: no file of this kind is")
