"""Reading and writing of small files. Writing is atomic; errors of reading name the file.

Also the names of the files in a run's output folder, for writers and readers.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tokenize import TokenError
from typing import TYPE_CHECKING, Any, BinaryIO

from hlp.errors import DataError, InputError, MissingFileError
from hlp.folders import own_files

if TYPE_CHECKING:
    import numpy as np  # takes 0.1 s to import, and a command that shows settings needs no array

MANIFEST = "manifest.json"
"""What the result was made from. It is written last: a folder with one holds a complete result."""
SUMMARY = "summary.json"
"""Recalls, times and causes of misses. Only runs of the whole method have one."""
TIMES = "timing.json"
"""Times alone, as in the summary: of a run on frames whose true poses are private."""
SCORES = "scores.csv"
"""Errors and verdicts, one row for each target."""
POSES = "poses.csv"
"""Estimated poses in BOP's results format."""
PAGE = "report.html"
"""Everything about a run or a sweep as one page for a browser."""
SWEEP = "sweep.json"
"""What was swept. The sweep's runs are in the folders 0, 1, … beside it."""

MOST_BYTES = 512 * 1024**2
"""A larger JSON file is an error: it would fill the memory. BOP's largest have 100 MB."""
_DEEPEST = 64  # lists and objects within each other in JSON
_ROOM, _MOST_RATIO = 512 * 1024**2, 20  # bytes unpacked of an archive, and for each packed one
_MOST_EVENTS = 5_000  # of a YAML text, and twice the letters of a value: its parser is slow
_UNFINISHED = re.compile(r"\..+\.\d+")
_GROUPED = re.compile(r"[-+.]?\d[\d.]*_[-+.\d_eE]*")  # digits, which YAML takes for a number
NO_ARRAYS = (
    ValueError, TypeError, KeyError, EOFError, OSError, zipfile.BadZipFile, zlib.error,
    NotImplementedError, RuntimeError, MemoryError, SyntaxError, OverflowError, TokenError,
)  # fmt: skip
"""All that numpy raises for broken files, and for headers of arrays that no memory holds."""


@contextmanager
def replaced(path: Path) -> Iterator[BinaryIO]:
    """Open a stream whose content replaces the file's when the block ends without an error.

    Until then, and after an error, the file stays as it was. Folders are made as needed. Raises
    OSError, which names the file, if it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with partial.open("wb") as stream:
            yield stream
        os.replace(partial, path)
    except OSError as error:
        if error.errno is not None and error.filename is None:  # as of a full disk
            error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def remove_unfinished(folder: Path) -> None:
    """Remove what `replaced` was writing when its process was killed. Raises as `own_files`."""
    for path in own_files(folder):
        if _UNFINISHED.fullmatch(path.name):
            path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Replace a file's content by a text, in UTF-8."""
    with replaced(path) as stream:
        stream.write(text.encode())


def write_json(path: Path, content: Any) -> None:
    """Replace a file's content by indented JSON. Raises TypeError for values that JSON lacks."""
    write_text(path, json.dumps(content, indent=2) + "\n")


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Replace a file's content by a header and rows of comma-separated values."""
    text = io.StringIO()
    plain, quoted = (
        csv.writer(text, lineterminator="\n", quoting=quoting)
        for quoting in (csv.QUOTE_MINIMAL, csv.QUOTE_ALL)
    )
    plain.writerow(columns)
    for row in rows:  # unquoted, a carriage return would end the line when it is read
        (quoted if any("\r" in str(cell) for cell in row) else plain).writerow(row)
    write_text(path, text.getvalue())


def write_array(path: Path, shape: tuple[int, ...], parts: Iterable[np.ndarray]) -> None:
    """Replace a file's content by an array in NumPy's .npy format, given in one or more parts.

    Together they have the `shape`. Raises OSError with the system's reason. `np.save` loses it: on
    a full disk it counts bytes.
    """
    import numpy as np

    with replaced(path) as stream:
        for number, part in enumerate(parts):
            part = np.ascontiguousarray(part)
            if number == 0:
                header = np.lib.format.header_data_from_array_1_0(part) | {"shape": shape}
                np.lib.format.write_array_header_1_0(stream, header)
            stream.write(part.data)


def read_json(path: Path, most_bytes: int = MOST_BYTES) -> Any:
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
        raise DataError(f"{path} is not JSON: it is not in UTF-8 ({error.reason})") from error
    except PermissionError as error:
        raise DataError(f"{path} may not be read: give yourself the right to") from error
    return parse_json(text, str(path))


def parse_json(text: str, where: str) -> Any:
    """Parsed JSON of a text; see `read_json`."""

    def distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            (name, _), *_ = Counter(name for name, _ in pairs).most_common(1)
            raise DataError(f"{where} states the key {name!r} twice: leave one out")
        return found

    try:
        content = json.loads(text, object_pairs_hook=distinct, parse_constant=_no_number)
        level: list[Any] = [[content]]
        for _ in range(_DEEPEST + 1):
            held = (outer.values() if isinstance(outer, dict) else outer for outer in level)
            level = [inner for own in held for inner in own if isinstance(inner, dict | list)]
            if not level:
                return content
        raise RecursionError
    except RecursionError as error:  # Python's, or more than any file has
        problem = f"is nested deeper than {_DEEPEST} levels: no file of this kind is"
        raise DataError(f"{where} {problem}") from error
    except DataError:
        raise
    except ValueError as error:
        raise DataError(f"{where} is not JSON: {error}") from error


def parse_yaml(text: str, where: str) -> Any:
    """The first document of a YAML text of plain values; None where there is none.

    Raises DataError for anything else: tags, *name, 3_00, what is nested too deeply or too long.
    """
    import yaml

    depth = 0
    try:
        for count, event in enumerate(yaml.parse(text, yaml.SafeLoader)):
            name, value = type(event).__name__, getattr(event, "value", "")
            depth += name.endswith("StartEvent") - name.endswith("EndEvent")
            if depth > _DEEPEST or count > _MOST_EVENTS or len(value) > _MOST_EVENTS // 2:
                raise DataError(f"{where} is nested too deeply or too long: no file of its kind is")
            grouped = value and not event.style and _GROUPED.fullmatch(value)
            if grouped or name == "AliasEvent" or getattr(event, "tag", None):
                raise DataError(f"{where} has a tag, *name or 3_00: write the values out")
            if name == "DocumentEndEvent":  # `rostopic echo` ends with ---
                break
        return next(iter(yaml.safe_load_all(text)), None)
    except DataError:
        raise
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise DataError(f"{where} is not YAML: {str(error).splitlines()[0]}") from error


def expanded(path: str | Path) -> Path:
    """The path with ~ expanded. Raises InputError for the home of nobody."""
    with suppress(RuntimeError, ValueError):  # a name that no user can have is a ValueError
        return Path(path).expanduser()
    raise InputError(f"{path}: there is no such user")


def _no_number(name: str) -> None:
    raise ValueError(f"{name} is no value of JSON")


def read_csv(path: Path, columns: Sequence[str], *, more: bool = False) -> list[dict[str, Any]]:
    """Rows of a CSV file by column name; the first row is line 2.

    With `more`, further columns may follow. Raises MissingFileError, or DataError naming a file
    whose first line is not `columns`, whose lines are of other lengths, or that is not text.
    """
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}")
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            reader = csv.DictReader(stream)
            names = tuple(reader.fieldnames or ())
            if (names[: len(columns)] if more else names) != tuple(columns):
                raise DataError(f"{path}: the first line must be {','.join(columns)}")
            rows = list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{path} is damaged, or no table in UTF-8 ({error})") from error
    for line, row in enumerate(rows, start=2):
        if None in row or None in row.values():
            raise DataError(f"{path}, line {line}: it must have {len(names)} cells")
    return rows


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an .npz file. Raises MissingFileError, or DataError naming a damaged file."""
    import numpy as np

    if not path.is_file():
        raise MissingFileError(f"there is no file {path}")
    try:
        # numpy leaves a file open that is not an archive, unless somebody else opened it.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            stated = sum(array.file_size for array in stored.zip.infolist())
            if stated > _ROOM + _MOST_RATIO * path.stat().st_size:
                raise ValueError(f"it states {stated} bytes, more than any that HLP wrote")
            return dict(stored)
    except NO_ARRAYS as error:
        raise DataError(
            f"{path} is damaged ({error}): delete its folder to make it again, or copy it anew"
        ) from error


def shipped_folder(name: str) -> Path:
    """A folder that comes with HLP: inside an installed package, or the checkout's own.

    Raises MissingFileError where there is none.
    """
    package = Path(__file__).parent
    folders = (package / name, package.parents[1] / name)
    for folder in folders:
        if folder.is_dir():
            return folder
    raise MissingFileError(f"no folder {' or '.join(map(str, folders))}: reinstall hlp")


def config_folder() -> Path:
    """Folder of the configuration."""
    return shipped_folder("conf")


EXAMPLE = "example"
"""A learnt object and a frame of it that come with HLP: their folder, and what `learnt` names."""
