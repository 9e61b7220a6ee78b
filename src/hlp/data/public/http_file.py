"""Loading of a large file over HTTP: continued after a cut, compared with its checksum."""

import hashlib
import re
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import requests
from tqdm import tqdm

from hlp.data.public.sets import Archive
from hlp.errors import DataError, DiskFullError, HlpError, NetworkError
from hlp.files import read_json, write_json

PARTIAL = ".part"
WAITS = (1.0, 4.0, 15.0)
"""Seconds before each new attempt after one that brought nothing."""
_TIMEOUT = (20.0, 60.0)  # s: to connect, and without any byte
_CHUNK = 1 << 16  # at most that much is lost with a cut
_RESERVE = 50e6  # bytes that stay free
_CUTS = (requests.ConnectionError, requests.Timeout, requests.exceptions.ChunkedEncodingError)
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class LoadedFile:
    """A whole file. `verified` says with what it was compared, beside its size."""

    path: Path
    sha256: str
    verified: str


@dataclass(frozen=True)
class Announced:
    """What a server says of a file: its size (bytes), SHA-256, and a mark of its version."""

    size: int | None
    sha256: str | None
    version: str | None


class _CutError(Exception):
    """The connection ended before the file did, or the server is busy; another attempt may help."""


def fetch(archive: Archive, target: Path, waits: Sequence[float] = WAITS) -> LoadedFile:
    """Load a file to `target`, unless it is there; what is there of it already is continued.

    Until it is whole and verified, it is called `target` + `.part`. It is continued only if the
    server still has the same version, and accepts ranges. Raises NetworkError, and DiskFullError;
    both keep what was loaded. Raises DataError, and deletes it, for a wrong size or checksum.
    """
    part = target.with_name(target.name + PARTIAL)
    if target.is_file():
        return _verified(target, archive, Announced(None, None, None))
    with requests.Session() as session:
        announced = _receive_all(session, archive, part, waits)
    try:
        loaded = _verified(part, archive, announced)
    except DataError:
        part.unlink()
        raise
    part.rename(target)
    _notes(part).unlink(missing_ok=True)
    return LoadedFile(target, loaded.sha256, loaded.verified)


def _receive_all(
    session: requests.Session, archive: Archive, part: Path, waits: Sequence[float]
) -> Announced:
    """Attempts until the file is whole; one that brought something sets the count back."""
    remaining = list(waits)
    while True:
        before = _size(part)
        try:
            return _receive(session, archive, part)
        except (*_CUTS, _CutError) as error:
            if _size(part) > before:
                remaining = list(waits)
            elif not remaining or (before == 0 and isinstance(error, requests.ConnectionError)):
                raise NetworkError(_in_words(archive, error, part)) from error
            time.sleep(remaining.pop(0) if remaining else 0.0)
        except requests.RequestException as error:
            raise NetworkError(_in_words(archive, error, part)) from error


def _in_words(archive: Archive, error: Exception, part: Path) -> str:
    host = archive.url.split("/")[2] if "//" in archive.url else archive.url
    reason = str(error) if isinstance(error, _CutError) else type(error).__name__
    kept = "nothing is loaded yet"
    if _size(part):
        kept = f"{_size(part) / 1e6:.1f} MB are kept in {part}"
    return (
        f"{archive.url} cannot be loaded from {host} ({reason}); {kept}: check the network, and "
        "call again to continue, or give another server with mirror=URL"
    )


def _receive(session: requests.Session, archive: Archive, part: Path) -> Announced:
    """One request: append what is missing, or write all anew if it cannot be continued."""
    noted = _noted_version(part)
    have = _size(part) if noted is not None else 0
    asked = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
    with session.get(archive.url, headers=asked, stream=True, timeout=_TIMEOUT) as response:
        announced = _announced(response)
        status = response.status_code
        if have and (status == 416 or (status == 206 and not _continues(response, have))):
            if status == 416 and announced.size == have and announced.version == noted:
                return announced  # whole already, only not verified
            part.unlink()
        elif have and status == 206 and announced.version != noted:
            part.unlink()
        elif status in (200, 206):
            _check_announced(archive, announced)
            _check_room(part, announced, have if status == 206 else 0)
            write_json(_notes(part), {"version": announced.version})
            _write(response, part, have if status == 206 else 0, announced)
            return announced
        elif status == 429 or status >= 500:
            raise _CutError(f"the server answers {status}")
        else:
            raise NetworkError(
                f"{archive.url}: the server answers {status} {response.reason}: check mirror=URL, "
                "or load the file yourself and see the data set's page"
            )
    return _receive(session, archive, part)


def _write(response: requests.Response, part: Path, have: int, announced: Announced) -> None:
    bar = tqdm(
        total=announced.size, initial=have, desc=part.name.removesuffix(PARTIAL), unit="B",
        unit_scale=True, disable=not sys.stderr.isatty(), leave=False,
    )  # fmt: skip
    with bar, part.open("ab" if have else "wb") as stream:
        for chunk in response.iter_content(_CHUNK):
            stream.write(chunk)
            bar.update(len(chunk))
    if announced.size is not None and _size(part) < announced.size:
        raise _CutError("the connection was cut")


def _announced(response: requests.Response) -> Announced:
    """What the answer and the redirections before it say.

    Hugging Face redirects large files, and states their SHA-256 and size where it does.
    """
    linked = [each.headers for each in response.history if "X-Linked-ETag" in each.headers]
    headers = [*linked, response.headers][0]
    mark = headers.get("X-Linked-ETag", headers.get("ETag", headers.get("Last-Modified")))
    plain = (mark or "").strip('W/"')
    stated = "X-Linked-ETag" in headers and _SHA256.fullmatch(plain)
    size = response.headers.get("Content-Length")
    if response.status_code in (206, 416):
        size = response.headers.get("Content-Range", "").rpartition("/")[2]
    return Announced(
        int(size) if size and size.isdecimal() else None, plain if stated else None, mark
    )


def _continues(response: requests.Response, have: int) -> bool:
    return response.headers.get("Content-Range", "").startswith(f"bytes {have}-")


def _check_announced(archive: Archive, announced: Announced) -> None:
    """Before anything is loaded: another file than the known one is not wanted."""
    kind, _, known = (archive.checksum or "").partition(":")
    if kind == "sha256" and announced.sha256 not in (None, known):
        raise _wrong(archive, f"its checksum is {announced.sha256}, not {known}", "was not loaded")
    if None not in (archive.size, announced.size) and archive.size != announced.size:
        raise _wrong(
            archive, f"it has {announced.size} bytes, not {archive.size}", "was not loaded"
        )


def _check_room(part: Path, announced: Announced, have: int) -> None:
    free = shutil.disk_usage(part.parent).free
    needed = (announced.size or have) - have
    if free < needed + _RESERVE:
        raise DiskFullError(
            f"{part.parent} has {free / 1e9:.1f} GB free, the rest of {part.name} takes "
            f"{needed / 1e9:.1f}: free some, or choose another disk with output=FOLDER"
        )


def _verified(path: Path, archive: Archive, announced: Announced) -> LoadedFile:
    """Compare a whole file with all that is known of it. Raises DataError."""
    size = path.stat().st_size
    for expected in (archive.size, announced.size):
        if expected is not None and size != expected:
            raise _wrong(archive, f"it has {size} bytes, not {expected}", f"deleted: {path}")
    sha256 = _digest(path, "sha256")
    verified = []
    kind, _, known = (archive.checksum or "").partition(":")
    for name, digest in ((kind, known), ("sha256", announced.sha256 or "")):
        if not digest:
            continue
        found = sha256 if name == "sha256" else _digest(path, name)
        if found != digest:
            raise _wrong(archive, f"its {name} is {found}, not {digest}", f"deleted: {path}")
        verified.append(f"{name} {'known' if digest == known else 'of the server'}")
    return LoadedFile(path, sha256, ", ".join(dict.fromkeys(verified)) or "size alone")


def _wrong(archive: Archive, problem: str, done: str) -> HlpError:
    return DataError(
        f"{archive.url} is not the file that it should be: {problem} ({done}). Call again, or give "
        "another server with mirror=URL"
    )


def _digest(path: Path, kind: str) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, kind).hexdigest()


def _notes(part: Path) -> Path:
    return part.with_name(part.name + ".json")


def _noted_version(part: Path) -> str | None:
    """The version of which a partial file is the beginning; None if that is not known."""
    try:
        version = read_json(_notes(part)).get("version")
    except (HlpError, AttributeError):
        return None
    return version if isinstance(version, str) else None


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0
